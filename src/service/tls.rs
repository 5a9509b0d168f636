//! Which cryptography TLS uses: the only file that names rustls.

use rustls::CertificateError;
use rustls::crypto::ring;
use std::error::Error;

/// Makes ring the one provider of this process, for every client that will speak TLS. Asked before the first of them; asked
/// again, it changes nothing.
pub fn install() {
    // An error says that there is one already.
    let _ = ring::default_provider().install_default();
}

/// What an error of TLS says of whom was asked, for a client who named it; `None` for another error.
pub fn words(error: &(dyn Error + 'static)) -> Option<&'static str> {
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
