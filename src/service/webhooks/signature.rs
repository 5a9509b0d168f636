//! Secrets and signatures as Standard Webhooks has them: the only file that names hmac.

use crate::accounts::keys::random;
use crate::storage::error::Error;
use base64::Engine;
use base64::engine::general_purpose::STANDARD as BASE64;
use hmac::{Hmac, KeyInit, Mac};
use sha2::Sha256;

/// What every secret begins with, so that scanners of leaked secrets can find it.
const PREFIX: &str = "whsec_";
/// The standard has 24 to 64.
const SECRET_BYTES: usize = 32;

/// A new secret.
///
/// # Errors
/// The system has no randomness.
pub fn secret() -> Result<String, Error> {
    Ok(format!("{PREFIX}{}", BASE64.encode(random::<SECRET_BYTES>()?)))
}

/// The header `webhook-signature`: one signature for each of `secrets`, with spaces between.
///
/// # Errors
/// A secret that is none.
pub fn sign(secrets: &[String], id: &str, timestamp_s: i64, body: &str) -> Result<String, Error> {
    let mut signatures = Vec::new();
    for secret in secrets {
        let wrong = || Error::fault("a webhook's secret cannot be read");
        let key = secret.strip_prefix(PREFIX).and_then(|text| BASE64.decode(text).ok()).ok_or_else(wrong)?;
        let mut mac = Hmac::<Sha256>::new_from_slice(&key).map_err(|_| wrong())?;
        mac.update(format!("{id}.{timestamp_s}.{body}").as_bytes());
        signatures.push(format!("v1,{}", BASE64.encode(mac.finalize().into_bytes())));
    }
    Ok(signatures.join(" "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_reference_vector_is_signed_as_everybody_signs_it() {
        // The vector in the tests of the standard's own libraries.
        let secret = "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw".to_owned();
        let signature =
            sign(&[secret], "msg_p5jXN8AQM9LWM0D4loKWxJek", 1_614_265_330, r#"{"test": 2432232314}"#).unwrap();
        assert_eq!(signature, "v1,g0hM9SsE+OTPJTGt/tmIKtSyZlE3uFJELVlNIOLJ1OE=");
    }

    #[test]
    fn a_foreign_library_signs_the_same_with_each_of_our_secrets() {
        let secrets = [secret().unwrap(), secret().unwrap()];
        assert_ne!(secrets[0], secrets[1]);
        let (id, at, body) = ("019a", 1_700_000_000, r#"{"type":"ping","data":{"ü":1}}"#);
        let foreign = secrets
            .each_ref()
            .map(|secret| standardwebhooks::Webhook::new(secret).unwrap().sign(id, at, body.as_bytes()).unwrap());
        assert_eq!(sign(&secrets, id, at, body).unwrap(), foreign.join(" "));
        assert!(sign(&["whsec_!".into()], id, at, body).is_err() && sign(&["abc".into()], id, at, body).is_err());
    }
}
