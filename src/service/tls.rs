//! Which cryptography TLS uses: the only file that names rustls.

use rustls::CertificateError;
use rustls::crypto::ring;
use std::error::Error;

/// Makes ring the one provider of this process, for every client that will speak TLS. Called before the first of them; called
/// again, it changes nothing.
pub fn install() {
    // An error says that there is one already.
    let _ = ring::default_provider().install_default();
}

/// Describes an error of TLS to the client that gave the address; `None` if the error is not one of TLS.
pub fn describe(error: &(dyn Error + 'static)) -> Option<&'static str> {
    use CertificateError::{Expired, ExpiredContext, NotValidForName, NotValidForNameContext, UnknownIssuer};
    Some(match error.downcast_ref::<rustls::Error>()? {
        rustls::Error::InvalidCertificate(Expired | ExpiredContext { .. }) => "its certificate has expired",
        rustls::Error::InvalidCertificate(NotValidForName | NotValidForNameContext { .. }) => {
            "its certificate is for another host name"
        }
        rustls::Error::InvalidCertificate(UnknownIssuer) => "its certificate is not from a trusted authority",
        rustls::Error::InvalidCertificate(_) => "its certificate is not valid",
        _ => "no TLS connection could be made",
    })
}
