//! The query parameters of uploads (name, declarations, metadata) and of the list of ray sets.

use super::extract::Page;
use super::problem::{Problem, SEND_THE_FILE};
use crate::metadata::Metadata;
use crate::ray_sets::announcement::Announcement;
use crate::ray_sets::declaration::{FileDeclaration, LengthUnit, QuantityName};
use crate::ray_sets::error::in_query;
use axum::http::{HeaderMap, HeaderName, header};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use serde::Deserialize;

/// Longest name of a file, a channel or a spectrum, characters.
pub const MAX_NAME_CHARS: usize = 255;

/// The query parameter that names an uploaded file.
#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct Naming {
    /// The name of the file, for display only; overrides the name in `Content-Disposition`.
    #[param(max_length = 255)]
    pub name: Option<String>,
}

/// The query parameters of an upload of a ray file: its name, its metadata, and declarations about it or about every file in an
/// archive.
#[derive(Debug, Default, Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct UploadQuery {
    /// The name of the file, for display only; overrides the name in `Content-Disposition`.
    #[param(max_length = 255)]
    pub name: Option<String>,
    /// The length unit of the positions in the file; overrides what the file says.
    length_unit: Option<LengthUnit>,
    /// Whether the flux values in the file are radiant (W) or luminous (lm); overrides what the file says.
    quantity: Option<QuantityName>,
    /// The meaning of each column, separated by commas, for text files only: x, y, z, l, m, n, flux,
    /// radiant_flux, luminous_flux, wavelength_nm, wavelength_um, tristimulus_x, tristimulus_z, ignored.
    #[param(example = "x,y,z,l,m,n,flux")]
    columns: Option<String>,
    /// The client's own metadata, as a JSON object of strings: at most 16 entries and 4096 bytes in all; keys of 1 to 64
    /// characters of A-Z, a-z, 0-9, _, . and -; values of at most 512 characters. Every ray set that is made of the file gets
    /// them.
    #[param(value_type = Option<String>, example = "{\"order\":\"4711\"}")]
    #[serde(default, deserialize_with = "Metadata::from_text")]
    pub metadata: Metadata,
}

impl UploadQuery {
    /// The declarations of the query.
    ///
    /// # Errors
    /// `rays.column_unknown`.
    pub fn declaration(&self) -> Result<FileDeclaration, Problem> {
        let columns = self.columns.as_ref().map(|list| list.split(',').map(|name| name.trim().to_owned()).collect());
        let declared = FileDeclaration { length_unit: self.length_unit, quantity: self.quantity, columns };
        declared.resolve().map_err(in_query)?;
        Ok(declared)
    }
}

/// A page of the list of ray sets.
#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct RaySetPage {
    /// Only ray sets with this name.
    pub name: Option<String>,
    /// Only ray sets whose file has this SHA-256: tells whether a file was uploaded before.
    #[param(pattern = "^[0-9A-Fa-f]{64}$")]
    pub sha256: Option<String>,
    /// Only ray sets whose metadata has all of these keys and values: a JSON object of strings.
    #[param(value_type = Option<String>, example = "{\"order\":\"4711\"}")]
    #[serde(default, deserialize_with = "Metadata::from_text")]
    pub metadata: Metadata,
    /// The largest number of entries in the answer.
    #[param(minimum = 1, maximum = 100, default = 20)]
    #[serde(default = "Page::default_limit")]
    pub limit: u32,
    /// The value of `next` in the page before this one.
    #[param(value_type = Option<String>, pattern = "^([0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12})?$")]
    #[serde(default, deserialize_with = "Page::cursor")]
    pub after: Option<String>,
}

/// Reads what the headers and the query announce about a file; `nameless` is its name if they give none.
///
/// # Errors
/// The body is a form, or a header or the name is not valid.
pub fn announcement(name: Option<String>, headers: &HeaderMap, nameless: &str) -> Result<Announcement, Problem> {
    let text = |name: HeaderName| headers.get(&name).and_then(|value| value.to_str().ok());
    let media_type = text(header::CONTENT_TYPE).unwrap_or_default().to_ascii_lowercase();
    if media_type.starts_with("multipart/") || media_type.starts_with("application/x-www-form-urlencoded") {
        return Err(Problem::media_type(format!("The body is {media_type:?}."), SEND_THE_FILE));
    }
    let byte_count = match text(header::CONTENT_LENGTH).map(str::parse) {
        Some(Err(_)) => return Err(Problem::malformed_header("Content-Length", "The value is not a number.")),
        Some(Ok(bytes)) => Some(bytes),
        None => None,
    };
    let mut sha256 = Vec::new();
    for name in ["repr-digest", "content-digest"] {
        for value in headers.get_all(name) {
            sha256.extend(digest(name, value.to_str().unwrap_or_default())?);
        }
    }
    let name = name.or_else(|| text(header::CONTENT_DISPOSITION).and_then(file_name)).unwrap_or_default();
    Ok(Announcement { name: plain(&name, nameless)?, byte_count, sha256, ..Announcement::default() })
}

/// The SHA-256 in a digest header, as hex; other algorithms are left alone.
pub fn digest(header: &str, value: &str) -> Result<Option<String>, Problem> {
    let members = value.split(',').filter_map(|member| member.trim().split_once('='));
    let Some((_, value)) = members.into_iter().find(|(algorithm, _)| *algorithm == "sha-256") else {
        return Ok(None);
    };
    let wrong = || Problem::malformed_header(header, "sha-256 is not 32 bytes in base64 between colons.");
    let inner = value.strip_prefix(':').and_then(|value| value.strip_suffix(':')).ok_or_else(wrong)?;
    let bytes = BASE64.decode(inner).map_err(|_| wrong())?;
    if bytes.len() != 32 {
        return Err(wrong());
    }
    Ok(Some(crate::hex::hex(&bytes)))
}

/// The file name in a `Content-Disposition` (RFC 6266), `filename*` before `filename`.
pub fn file_name(disposition: &str) -> Option<String> {
    let parameter = |wanted: &str| {
        disposition.split(';').filter_map(|part| part.trim().split_once('=')).find_map(|(name, value)| {
            name.trim().eq_ignore_ascii_case(wanted).then(|| value.trim().trim_matches('"').to_owned())
        })
    };
    let extended = parameter("filename*").and_then(|value| {
        let encoded = value.get(..7).filter(|start| start.eq_ignore_ascii_case("utf-8''")).and(value.get(7..))?;
        Some(percent_decoded(encoded))
    });
    extended.or_else(|| parameter("filename"))
}

/// Decodes percent-encoded characters such as `%20`.
pub(super) fn percent_decoded(text: &str) -> String {
    let mut bytes = Vec::new();
    let mut rest = text.bytes();
    while let Some(byte) = rest.next() {
        let mut ahead = rest.clone();
        let digits = [ahead.next(), ahead.next()].map(|digit| digit.and_then(|digit| char::from(digit).to_digit(16)));
        match (byte, digits) {
            (b'%', [Some(high), Some(low)]) => {
                bytes.push((high * 16 + low) as u8);
                rest = ahead;
            }
            _ => bytes.push(byte),
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

/// A name without folders and control characters.
pub(super) fn plain(name: &str, nameless: &str) -> Result<String, Problem> {
    if name.chars().count() > MAX_NAME_CHARS {
        return Err(Problem::out_of_range("name", "at most 255 characters long"));
    }
    let last = name.rsplit(['/', '\\']).next().unwrap_or_default();
    let clean: String = last.chars().filter(|c| !c.is_control()).collect();
    Ok(if clean.is_empty() { nameless.to_owned() } else { clean })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_name_is_the_one_meant() {
        // RFC 6266 section 5 and RFC 8187 section 3.2.2, the examples there.
        assert_eq!(file_name(r#"Attachment; filename=example.html"#).as_deref(), Some("example.html"));
        assert_eq!(file_name(r#"attachment; filename= "foo bar.ray""#).as_deref(), Some("foo bar.ray"));
        let both = "attachment; filename=\"EURO rates\"; filename*=utf-8''%e2%82%ac%20rates";
        assert_eq!(file_name(both).as_deref(), Some("€ rates"));
        assert_eq!(file_name("inline"), None);
        assert_eq!(percent_decoded("100%"), "100%");
        assert_eq!(plain("../../etc/pass\u{7}wd", "rays").ok().as_deref(), Some("passwd"));
        assert_eq!(plain("C:\\rays\\led.dat", "rays").ok().as_deref(), Some("led.dat"));
        assert_eq!(plain("", "rays").ok().as_deref(), Some("rays"));
        assert_eq!(
            plain(&"x".repeat(256), "rays").map_err(|problem| problem.code).unwrap_err(),
            "request.out_of_range"
        );
    }

    #[test]
    fn a_digest_header_is_read_as_rfc_9530_writes_it() {
        // RFC 9530 appendix B.1: {"hello": "world"} and a line end.
        let example = "sha-256=:RK/0qy18MlBSVnWgjwz6lZEWjP/lF5HF9bvEF8FabDg=:";
        let hex = "44aff4ab2d7c3250525675a08f0cfa9591168cffe51791c5f5bbc417c15a6c38";
        assert_eq!(digest("repr-digest", example).unwrap().as_deref(), Some(hex));
        assert_eq!(digest("repr-digest", &format!("sha-512=:eA==:, {example}")).unwrap().as_deref(), Some(hex));
        assert_eq!(digest("repr-digest", "sha-512=:eA==:").unwrap(), None);
        for wrong in ["sha-256=abc", "sha-256=:eA==:", "sha-256=:!!:", "sha-256="] {
            assert_eq!(digest("repr-digest", wrong).unwrap_err().code, "request.malformed_header", "{wrong}");
        }
    }
}
