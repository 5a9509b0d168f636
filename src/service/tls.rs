//! Which cryptography TLS uses: the only file that names rustls.

use rustls::crypto::ring;

/// Makes ring the one provider of this process, for every client that will speak TLS. Asked before the first of them; asked
/// again, it changes nothing.
pub fn install() {
    // An error says that there is one already.
    let _ = ring::default_provider().install_default();
}
