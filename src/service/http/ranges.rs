//! Conditional and partial requests (RFC 9110 sections 13 and 14), for content whose entity tag is strong.

use axum::http::{HeaderMap, HeaderName, header};
use std::ops::Range;

/// The part of a file that a GET request asks for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Wanted {
    /// The whole file.
    Whole,
    /// Bytes from start to end, the end not included.
    Part(Range<u64>),
    /// Nothing, because the copy of the client is current.
    Nothing,
    /// A range outside the file.
    Unsatisfiable,
    /// Nothing, because `If-Match` is false.
    Changed,
}

/// What `headers` ask of a file of `byte_count` bytes with the entity tag `etag` (quotes included).
pub fn wanted(headers: &HeaderMap, etag: &str, byte_count: u64) -> Wanted {
    let text = |name: HeaderName| headers.get(name).and_then(|value| value.to_str().ok());
    // Compared strongly (RFC 9110, section 13.1.1): a weak tag is that of other bytes.
    let mut expected = tags(headers, header::IF_MATCH).peekable();
    if expected.peek().is_some() && !expected.any(|tag| tag == "*" || tag == etag) {
        return Wanted::Changed;
    }
    if tags(headers, header::IF_NONE_MATCH).any(|tag| tag == "*" || weak(tag) == etag) {
        return Wanted::Nothing;
    }
    // If-Range compares strongly, and a date never matches: we send none.
    if text(header::IF_RANGE).is_some_and(|tag| tag.trim() != etag) {
        return Wanted::Whole;
    }
    text(header::RANGE).map_or(Wanted::Whole, |range| part(range, byte_count))
}

/// The entity tags of a condition.
fn tags(headers: &HeaderMap, name: HeaderName) -> impl Iterator<Item = &str> {
    let lists = headers.get_all(name).into_iter().map(|value| value.to_str().unwrap_or("?"));
    lists.flat_map(|list| list.split(',')).map(str::trim)
}

/// A tag as the weak comparison sees it.
fn weak(tag: &str) -> &str {
    tag.strip_prefix("W/").unwrap_or(tag)
}

/// One range; what is not one, in bytes, is ignored as the standard allows.
fn part(range: &str, byte_count: u64) -> Wanted {
    let Some((unit, spec)) = range.split_once('=') else { return Wanted::Whole };
    let Some((first, last)) = spec.trim().split_once('-') else { return Wanted::Whole };
    if !unit.trim().eq_ignore_ascii_case("bytes") || spec.contains(',') {
        return Wanted::Whole;
    }
    let digits = |text: &str| text.bytes().all(|byte| byte.is_ascii_digit());
    let (first, last) = (first.trim(), last.trim());
    if !digits(first) || !digits(last) || (first.is_empty() && last.is_empty()) {
        return Wanted::Whole;
    }
    // A number too large for u64 is past any end.
    let number = |text: &str| text.parse::<u64>().unwrap_or(u64::MAX);
    if first.is_empty() {
        let count = number(last).min(byte_count);
        return if count == 0 { Wanted::Unsatisfiable } else { Wanted::Part(byte_count - count..byte_count) };
    }
    let (start, end) = (number(first), if last.is_empty() { u64::MAX } else { number(last) });
    if end < start {
        return Wanted::Whole;
    }
    if start >= byte_count {
        return Wanted::Unsatisfiable;
    }
    Wanted::Part(start..end.saturating_add(1).min(byte_count))
}

/// A client that reads nothing but plain bytes says so.
const OCTETS: &str = "application/octet-stream";

/// The media type that a file is sent as: its own, unless `Accept` names plain bytes and nothing that its own type is.
pub fn media_type<'a>(headers: &HeaderMap, own: &'a str) -> &'a str {
    let essence = own.split(';').next().unwrap_or_default().trim();
    let family = essence.split('/').next().unwrap_or_default();
    let accepted = headers.get_all(header::ACCEPT).iter().filter_map(|value| value.to_str().ok());
    let named =
        accepted.flat_map(|value| value.split(',')).map(|range| range.split(';').next().unwrap_or_default().trim());
    let mut octets = false;
    for range in named {
        let (kind, rest) = range.split_once('/').unwrap_or((range, "*"));
        let fits_family = kind.eq_ignore_ascii_case(family) && rest == "*";
        if kind == "*" || fits_family || range.eq_ignore_ascii_case(essence) {
            return own;
        }
        octets |= range.eq_ignore_ascii_case(OCTETS);
    }
    if octets { OCTETS } else { own }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn asked(pairs: &[(HeaderName, &str)]) -> Wanted {
        let headers = pairs.iter().map(|(name, value)| (name.clone(), value.parse().unwrap())).collect();
        wanted(&headers, "\"tag\"", 10_000)
    }

    #[test]
    fn ranges_are_those_of_rfc_9110() {
        // RFC 9110 section 14.1.2: the examples, for a representation of 10000 bytes.
        let range = |text: &str| asked(&[(header::RANGE, text)]);
        assert_eq!(range("bytes=0-499"), Wanted::Part(0..500));
        assert_eq!(range("bytes=500-999"), Wanted::Part(500..1000));
        assert_eq!(range("bytes=-500"), Wanted::Part(9500..10_000));
        assert_eq!(range("bytes=9500-"), Wanted::Part(9500..10_000));
        assert_eq!(range("bytes=9999-20000"), Wanted::Part(9999..10_000));
        assert_eq!(range("bytes=-20000"), Wanted::Part(0..10_000));
        assert_eq!(range("bytes=0-99999999999999999999"), Wanted::Part(0..10_000));
        for none in ["bytes=10000-", "bytes=-0", "bytes=99999999999999999999-"] {
            assert_eq!(range(none), Wanted::Unsatisfiable, "{none}");
        }
        for ignored in
            ["bytes=0-0,-1", "lines=0-1", "bytes=5-4", "bytes=", "bytes=-", "bytes", "bytes=a-b", "bytes=+1-2"]
        {
            assert_eq!(range(ignored), Wanted::Whole, "{ignored}");
        }
    }

    #[test]
    fn conditions_come_before_ranges() {
        let range = (header::RANGE, "bytes=0-1");
        for known in ["\"tag\"", "W/\"tag\"", "*", "\"other\", \"tag\""] {
            assert_eq!(asked(&[(header::IF_NONE_MATCH, known), range.clone()]), Wanted::Nothing, "{known}");
        }
        assert_eq!(asked(&[(header::IF_NONE_MATCH, "\"other\""), range.clone()]), Wanted::Part(0..2));
        assert_eq!(asked(&[(header::IF_RANGE, "\"tag\""), range.clone()]), Wanted::Part(0..2));
        for other in ["\"other\"", "W/\"tag\"", "Sun, 22 Nov 2026 00:00:00 GMT"] {
            assert_eq!(asked(&[(header::IF_RANGE, other), range.clone()]), Wanted::Whole, "{other}");
        }
    }

    #[test]
    fn a_file_that_is_not_the_expected_one_is_not_sent() {
        // RFC 9110, sections 13.1.1 and 13.2.2: If-Match before everything else, by the strong comparison.
        let none = (header::IF_NONE_MATCH, "\"tag\"");
        for other in ["\"other\"", "W/\"tag\"", "", "\"other\", W/\"tag\""] {
            assert_eq!(asked(&[(header::IF_MATCH, other), none.clone()]), Wanted::Changed, "{other}");
        }
        for same in ["\"tag\"", "*", "\"other\" , \"tag\""] {
            assert_eq!(asked(&[(header::IF_MATCH, same)]), Wanted::Whole, "{same}");
            assert_eq!(asked(&[(header::IF_MATCH, same), none.clone()]), Wanted::Nothing, "{same}");
        }
    }

    #[test]
    fn an_empty_file_has_no_range() {
        let headers = [(header::RANGE, "bytes=0-0".parse().unwrap())].into_iter().collect();
        assert_eq!(wanted(&headers, "\"tag\"", 0), Wanted::Unsatisfiable);
    }

    #[test]
    fn a_file_has_its_own_type_unless_only_plain_bytes_are_accepted() {
        let asked = |accept: &[&str]| {
            let values = accept.iter().map(|value| (header::ACCEPT, value.parse().unwrap()));
            let headers: HeaderMap = values.collect();
            media_type(&headers, "text/csv; charset=utf-8").to_owned()
        };
        let own = "text/csv; charset=utf-8";
        for accept in [&[][..], &["*/*"], &["text/*"], &["TEXT/csv;q=0.5, application/octet-stream"], &["image/png"]] {
            assert_eq!(asked(accept), own, "{accept:?}");
        }
        for accept in [&["application/octet-stream"][..], &["image/png", "Application/Octet-Stream; q=0.9"]] {
            assert_eq!(asked(accept), "application/octet-stream", "{accept:?}");
        }
    }
}
