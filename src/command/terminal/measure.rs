//! Sizes, times and counts as an operator writes them, on the command line and in variables: `4GiB`, `2h`, `30d`. A number
//! without a unit is in the unit that its argument names. The error is what clap prints after the value.

use bytesize::ByteSize;
use std::str::FromStr;
use std::time::Duration;

/// Longest time that is taken: what is added to now must stay a moment that the databases can write (milliseconds in 64 bits).
const LONGEST: Duration = Duration::from_secs(u32::MAX as u64 * 86_400);
/// What a worker's clocks can tell apart at best.
const SHORTEST: Duration = Duration::from_secs(1);

/// A size in bytes: `4GiB`, `500MB`, `1048576`. K, M, G are powers of 1000, Ki, Mi, Gi powers of 1024.
///
/// # Errors
/// It is no size.
pub fn bytes(text: &str) -> Result<u64, String> {
    let wrong = "write a size as 10GiB, 500MB or 1048576 (MB is 1000 kB, MiB is 1024 KiB)";
    ByteSize::from_str(text.trim()).map(|size| size.as_u64()).map_err(|_| wrong.to_owned())
}

/// As [`bytes`], and more than none.
///
/// # Errors
/// It is no size, or 0.
pub fn some_bytes(text: &str) -> Result<u64, String> {
    match bytes(text)? {
        0 => Err("0 would accept nothing; leave the option out for the default".to_owned()),
        size => Ok(size),
    }
}

/// A whole number that is not 0.
///
/// # Errors
/// It is none.
pub fn at_least_one<T: FromStr + PartialOrd + From<u8>>(text: &str) -> Result<T, String> {
    let number = text.trim().parse().ok().filter(|number| *number >= T::from(1));
    number.ok_or_else(|| "write a whole number of at least 1".to_owned())
}

/// A number, whatever its sign.
///
/// # Errors
/// It is none.
pub fn number(text: &str) -> Result<f64, String> {
    text.trim().parse().map_err(|_| "write a number, as 2.5 or 1e-3, without a unit".to_owned())
}

/// A whole number, 0 or more: `64`, `1e2`.
///
/// # Errors
/// It is none, or too large.
pub fn whole<T: FromStr + TryFrom<u64>>(text: &str) -> Result<T, String> {
    let plain = text.trim().parse().ok();
    let power = || pipeline::count(text.trim()).and_then(|count| T::try_from(count).ok());
    plain.or_else(power).ok_or_else(|| "write a whole number, as 64 or 1e2".to_owned())
}

/// A number of rays: `1000000`, `1e6`, `2.5e8`.
///
/// # Errors
/// It is none, or 0.
pub fn rays(text: &str) -> Result<u64, String> {
    pipeline::count(text).ok_or_else(|| "write a number of rays as 1000000 or 1e6".to_owned())
}

/// A time: `90s`, `1h 30m`; a number alone means seconds.
///
/// # Errors
/// It is no time.
pub fn seconds(text: &str) -> Result<Duration, String> {
    time(text, Duration::from_secs(1))
}

/// As [`seconds`], and a second at least.
///
/// # Errors
/// It is no time, or too short.
pub fn some_seconds(text: &str) -> Result<Duration, String> {
    long_enough(seconds(text)?)
}

/// A time: `30d`, `36h`; a number alone means hours.
///
/// # Errors
/// It is no time.
pub fn hours(text: &str) -> Result<Duration, String> {
    time(text, Duration::from_hours(1))
}

/// A time of a second at least: `30d`, `36h`; a number alone means days.
///
/// # Errors
/// It is no time, or too short.
pub fn some_days(text: &str) -> Result<Duration, String> {
    long_enough(time(text, Duration::from_hours(24))?)
}

fn time(text: &str, unit: Duration) -> Result<Duration, String> {
    let text = text.trim();
    let written = match text.parse::<u32>() {
        Ok(count) => unit.checked_mul(count),
        Err(_) if !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit()) => None,
        Err(_) => {
            let parsed = humantime::parse_duration(text);
            Some(parsed.map_err(|_| "write a time as 30s, 15m, 2h, 7d or 1h 30m".to_owned())?)
        }
    };
    written.filter(|time| *time <= LONGEST).ok_or_else(|| "the time is too long".to_owned())
}

fn long_enough(time: Duration) -> Result<Duration, String> {
    if time < SHORTEST { Err("write at least one second".to_owned()) } else { Ok(time) }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HOUR: Duration = Duration::from_hours(1);

    #[test]
    fn sizes_are_read_as_people_write_them() {
        // IEC 80000-13 (KiB, MiB, GiB) and the SI prefixes.
        for (text, expected) in [
            ("0", 0),
            ("1048576", 1 << 20),
            ("4G", 4_000_000_000),
            ("4GB", 4_000_000_000),
            ("10GiB", 10 << 30),
            ("512MiB", 512 << 20),
            ("60 KiB", 60 << 10),
            ("1.5 GiB", 3 << 29),
            ("9007199254740993", 9_007_199_254_740_993),
        ] {
            assert_eq!(bytes(text), Ok(expected), "{text}");
        }
        for wrong in ["", "-1", "4 gigs", "GiB", "1e9", "0x10", "10 Gbit", "1,5GiB"] {
            assert!(bytes(wrong).is_err_and(|error| error.contains("10GiB")), "{wrong}");
        }
        assert!(some_bytes("0").is_err() && some_bytes("0MiB").is_err());
    }

    #[test]
    fn times_are_read_as_people_write_them_and_a_number_alone_has_the_unit_it_always_had() {
        for (text, expected) in [("30", 30), ("30s", 30), ("15m", 900), ("2h", 7200), ("1h 30m", 5400), ("1d", 86_400)]
        {
            assert_eq!(seconds(text), Ok(Duration::from_secs(expected)), "{text}");
        }
        assert_eq!((hours("24"), hours("30m")), (Ok(24 * HOUR), Ok(HOUR / 2)));
        assert_eq!((some_days("30"), some_days("36h")), (Ok(30 * 24 * HOUR), Ok(36 * HOUR)));
        assert_eq!((seconds("0"), seconds("500ms")), (Ok(Duration::ZERO), Ok(Duration::from_millis(500))));
        for wrong in ["", "-1", "x", "2 fortnights", "1:30", "1e3", "h"] {
            assert!(seconds(wrong).is_err_and(|error| error.contains("2h")), "{wrong}");
        }
        for short in ["0", "0s", "999ms"] {
            assert!(some_seconds(short).is_err() && some_days(short).is_err(), "{short}");
        }
        // What can be said in days could be before; what lies beyond is no moment.
        assert!(some_days("4294967295").is_ok() && seconds("4294967295").is_ok());
        for long in ["4294967296d", "99999999999999999999", "600000000000y"] {
            assert!(some_days(long).is_err(), "{long}");
        }
    }

    #[test]
    fn numbers_of_rays_are_read_as_people_write_them() {
        assert_eq!(rays("2.5e8"), Ok(250_000_000));
        for wrong in ["", "0", "-1", "1.5", "1e99", "many"] {
            assert!(rays(wrong).is_err_and(|error| error.contains("1e6")), "{wrong}");
        }
    }

    #[test]
    fn what_is_no_number_is_told_in_plain_words() {
        assert_eq!((number("-1e-3"), whole::<u64>(" 64 ")), (Ok(-1e-3), Ok(64)));
        assert!(number("20cm").is_err_and(|told| told.contains("without a unit")));
        assert_eq!((whole::<usize>("1e2"), whole::<u8>("1e2")), (Ok(100), Ok(100)));
        assert!(
            ["", "-1", "1e-3", "1.5"].iter().all(|text| whole::<usize>(text).is_err()) && whole::<u8>("1e3").is_err()
        );
    }

    #[test]
    fn counts_begin_at_one() {
        assert_eq!((at_least_one::<u32>("1"), at_least_one::<usize>("512")), (Ok(1), Ok(512)));
        for wrong in ["0", "-1", "1.5", "", "4294967296"] {
            assert!(at_least_one::<u32>(wrong).is_err(), "{wrong}");
        }
    }
}
