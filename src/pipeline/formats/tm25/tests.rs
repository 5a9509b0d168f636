//! Files made here, column by column, against the reader; the layout is checked against foreign files in `../tests.rs`.

use super::*;
use crate::formats::record::{RawRay, Records};
use header::Flags;
use writer::Writer;

const RAYS: u64 = 3;

fn ray(k: u64, flags: Flags) -> RawRay {
    let f = |present: bool, value: f64| if present { value } else { 0.0 };
    RawRay {
        origin_mm: [0.25, -1.5, k as f64],
        direction: [0.0, -1.0, 0.0],
        radiant: f(flags.radiant, 0.5 + k as f64),
        luminous: f(flags.luminous, 64.0),
        wavelength_nm: f(flags.wavelength, 450.0 + k as f64),
        table: if flags.index { (k % 2) as u32 } else { 0 },
        xz: [f(flags.tristimulus, 2.0), f(flags.tristimulus, 8.0)],
    }
}

/// One preamble per spectral identifier, each with other columns, tables and additional items.
fn preambles() -> Vec<Preamble> {
    let blue = vec![(440.0, 0.5), (450.0, 1.0), (460.5, 0.25)];
    let red = vec![(620.0, 0.5), (650.0, 1.0)];
    let text = "line one\nline two Ω".to_owned();
    let additional = Additional { columns: vec!["optical path".into(), "phase".into()], text };
    let flags = |radiant, wavelength, luminous, stokes, tristimulus, index| Flags {
        radiant,
        wavelength,
        luminous,
        stokes,
        tristimulus,
        index,
    };
    let kinds = [
        (SpectralId::None, flags(false, false, true, false, true, false), vec![], Additional::default()),
        (SpectralId::One, flags(true, false, true, false, false, false), vec![], additional.clone()),
        (SpectralId::PerRay, flags(true, true, false, true, false, false), vec![], Additional::default()),
        (SpectralId::OneTable, flags(false, false, true, false, false, false), vec![blue.clone()], additional),
        (
            SpectralId::IndexPerRay,
            flags(true, false, false, false, false, true),
            vec![blue, red],
            Additional::default(),
        ),
    ];
    kinds
        .into_iter()
        .map(|(spectral_id, flags, tables, additional)| {
            let header = Header {
                luminous_lm: Some(337.0),
                ray_count: RAYS,
                date: "2026-01-02T03:04:05Z".into(),
                spectral_id,
                wavelength_nm: (spectral_id == SpectralId::One).then_some(550.0),
                range_nm: [Some(440.0), None],
                flags,
                texts: std::array::from_fn(|k| format!("text {k}")),
                ..Header::default()
            };
            Preamble::new(header, Spectra::new(tables), additional)
        })
        .collect()
}

fn written(preamble: &Preamble) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut writer = Writer::start(&mut bytes, preamble).unwrap();
    let mut rows = Vec::new();
    for k in 0..preamble.header.ray_count {
        writer.rows().encode(&ray(k, preamble.header.flags), &[7.0], &mut rows);
    }
    writer.write(&rows).unwrap();
    assert!(writer.write(&rows).is_err(), "more rays than announced");
    writer.finish().unwrap();
    bytes
}

fn read(bytes: &[u8]) -> Result<(Preamble, Layout, Notices), Error> {
    let mut notices = Notices::default();
    let (preamble, layout) = read_preamble(&bytes.to_vec(), &Limits::default(), &mut notices)?;
    Ok((preamble, layout, notices))
}

fn put(bytes: &mut [u8], at: usize, word: [u8; 4]) {
    bytes[at..at + 4].copy_from_slice(&word);
}

fn opened(bytes: Vec<u8>) -> Result<RaySet, Error> {
    open(Arc::new(bytes), &Limits::default())
}

#[test]
fn what_is_written_is_read() {
    for preamble in preambles() {
        let bytes = written(&preamble);
        let (back, layout, notices) = read(&bytes).unwrap();
        assert_eq!(back, preamble);
        assert_eq!(notices, Notices::default());
        let records = Tm25Records::new(Arc::new(bytes), layout, 2);
        let mut rays = Vec::new();
        records.read(0, RAYS as usize, &mut rays).unwrap();
        let expected: Vec<RawRay> = (0..RAYS).map(|k| ray(k, preamble.header.flags)).collect();
        assert_eq!(rays, expected, "{:?}", preamble.header.spectral_id);
    }
}

#[test]
fn identifiers_become_the_spectra_they_mean() {
    let spectra: Vec<SpectralData> =
        preambles().iter().map(|preamble| opened(written(preamble)).unwrap().facts.spectral).collect();
    assert_eq!(spectra[0], SpectralData::Tristimulus);
    assert!(matches!(&spectra[1], SpectralData::Table(line) if line.range_nm() == (550.0, 550.0)));
    assert_eq!(spectra[2], SpectralData::Wavelength);
    assert!(matches!(&spectra[3], SpectralData::Table(table) if table.range_nm() == (440.0, 460.5)));
    assert!(matches!(&spectra[4], SpectralData::Tables(tables) if tables.len() == 2));
}

#[test]
fn every_prefix_is_refused_with_its_byte() {
    for preamble in preambles() {
        let bytes = written(&preamble);
        let (_, layout, _) = read(&bytes).unwrap();
        let fields = (0..=288).step_by(4);
        let texts = (0..=9).map(|k| 288 + 4000 * k);
        let rest = (PREAMBLE as usize..bytes.len()).step_by(4).chain([layout.start() as usize - 1, bytes.len() - 1]);
        for length in fields.chain(texts).chain(rest).filter(|length| *length < bytes.len()) {
            let prefix = bytes[..length].to_vec();
            let error = crate::formats::open(Arc::new(prefix), None, &Limits::default()).err();
            let Some(Error::Malformed(fault)) = error else { panic!("{length}: {error:?}") };
            assert!(fault.at.is_some(), "{length}: {fault:?}");
        }
        let longer = [bytes.as_slice(), &[0; 4]].concat();
        assert_eq!(opened(longer).err().unwrap().code(), "tm25.size");
    }
}

#[test]
fn a_lying_count_is_refused_before_anything_is_allocated_for_it() {
    let bytes = written(&preambles()[4]);
    for count in [2, 4, 400_000_000, u64::MAX, u64::MAX / 32] {
        let mut lying = bytes.clone();
        lying[20..28].copy_from_slice(&u64::to_le_bytes(count));
        assert_eq!(opened(lying).err().unwrap().code(), "tm25.size", "{count}");
    }
    let mut points = bytes.clone();
    put(&mut points, PREAMBLE as usize, i32::MAX.to_le_bytes());
    assert_eq!(opened(points).err().unwrap().code(), "rays.truncated");
    for (at, code) in [(76, "tm25.size"), (80, "tm25.size"), (84, "tm25.size")] {
        let mut lying = bytes.clone();
        put(&mut lying, at, i32::MAX.to_le_bytes());
        assert_eq!(opened(lying).err().unwrap().code(), code);
        let mut negative = bytes.clone();
        put(&mut negative, at, (-1_i32).to_le_bytes());
        assert_eq!(opened(negative).err().unwrap().code(), "tm25.negative_count");
    }
}

#[test]
fn headers_that_contradict_themselves() {
    let [none, one, per_ray, _, index] = <[Preamble; 5]>::try_from(preambles()).unwrap();
    let cases = [
        (&none, 256, 0, "tm25.no_rays"),
        (&none, 272, 0, "tm25.no_flux"),
        (&one, 280, 1, "tm25.size"),
        (&per_ray, 280, 1, "tm25.tristimulus"),
        (&index, PREAMBLE as usize, 0, "tm25.table"),
    ];
    for (preamble, at, word, code) in cases {
        let mut bytes = written(preamble);
        put(&mut bytes, at, i32::to_le_bytes(word));
        assert_eq!(opened(bytes).err().unwrap().code(), code, "word {word} at {at}");
    }
}

/// What a user can declare in its place is not fatal.
#[test]
fn spectra_that_cannot_be_meant_are_told() {
    let [none, one, _, _, index] = <[Preamble; 5]>::try_from(preambles()).unwrap();
    let first = PREAMBLE as usize + 4;
    for (preamble, at, word) in [
        (&none, 60, 9),
        (&one, 64, 0),
        (&one, 64, 50.0_f32.to_bits() as i32),
        (&one, 60, 2),
        (&one, 60, 3),
        (&index, first, (-5.0_f32).to_bits() as i32),
        (&index, first, 0.44_f32.to_bits() as i32),
        (&index, first + 4, (-0.5_f32).to_bits() as i32),
    ] {
        let mut bytes = written(preamble);
        put(&mut bytes, at, word.to_le_bytes());
        let facts = opened(bytes).unwrap().facts;
        assert_eq!(
            (facts.notices.count_of("rays.spectrum_unreadable"), facts.spectral),
            (1, SpectralData::None),
            "{word} at {at}"
        );
    }
}

/// One rule for tables and for spectrum files: dark noise is set to 0, and µm are known by their size.
#[test]
fn tables_are_mended_as_spectrum_files_are() {
    let index = &preambles()[4];
    let mut bytes = written(index);
    put(&mut bytes, PREAMBLE as usize + 8, (-0.01_f32).to_le_bytes());
    let facts = opened(bytes).unwrap().facts;
    assert_eq!(facts.notices.count_of("tm25.table_negative"), 1);
    assert_eq!(facts.spectral.tables()[0].points().next(), Some((440.0, 0.0)));
    let mut bytes = written(index);
    for (k, um) in [0.44_f32, 0.45, 0.4605].into_iter().enumerate() {
        put(&mut bytes, PREAMBLE as usize + 4 + 8 * k, um.to_le_bytes());
    }
    let facts = opened(bytes).unwrap().facts;
    assert_eq!(facts.notices.count_of("tm25.table_micrometres"), 1);
    let (low, high) = facts.spectral.tables()[0].range_nm();
    assert!((low - 440.0).abs() < 1e-4 && (high - 460.5).abs() < 1e-4, "{low} {high}");
}

#[test]
fn oddities_that_are_read_with_a_notice() {
    let table = &preambles()[4];
    let good = written(table);
    let mut version = good.clone();
    put(&mut version, 4, 2020_i32.to_le_bytes());
    let mut flag = good.clone();
    put(&mut flag, 284, (-1_i32).to_le_bytes());
    // The tables of identifier 4 end at 36 288 + 28 + 20, 16 bytes before the padded start.
    let mut unpadded = good.clone();
    unpadded.drain(36_336..36_352);
    let mut over_padded = good.clone();
    over_padded.splice(36_352..36_352, [0; 160]);
    let mut surrogate = good.clone();
    put(&mut surrogate, 288, 0xd800_i32.to_le_bytes());
    for (bytes, code) in [
        (version, "tm25.version"),
        (flag, "tm25.flags"),
        (unpadded, "tm25.unpadded_tables"),
        (over_padded, "tm25.over_padded"),
        (surrogate, "tm25.text"),
    ] {
        let set = opened(bytes).unwrap();
        assert_eq!(set.facts.notices.count_of(code), 1, "{code}");
        let mut rays = Vec::new();
        set.records.read(0, RAYS as usize, &mut rays).unwrap();
        assert_eq!(rays[2], ray(2, table.header.flags));
    }
}

/// A 2013 writer may give 3 Stokes columns: the file's length decides.
#[test]
fn three_stokes_columns_are_as_good_as_six() {
    let preamble = &preambles()[2];
    let six = written(preamble);
    let mut three = six[..PREAMBLE as usize].to_vec();
    for record in six[PREAMBLE as usize..].chunks_exact(4 * 14) {
        three.extend(&record[..4 * 11]);
    }
    let set = opened(three).unwrap();
    let mut rays = Vec::new();
    set.records.read(1, 2, &mut rays).unwrap();
    assert_eq!(rays, [ray(1, preamble.header.flags), ray(2, preamble.header.flags)]);
}

#[test]
fn limits_are_the_callers() {
    let bytes = written(&preambles()[4]);
    let limits = [
        (Limits { max_rays: 2, ..Limits::default() }, "rays.too_many"),
        (Limits { max_tables: 1, ..Limits::default() }, "tm25.too_many_tables"),
        (Limits { max_table_points: 4, ..Limits::default() }, "tm25.too_many_table_points"),
    ];
    for (limits, code) in limits {
        assert_eq!(open(Arc::new(bytes.clone()), &limits).err().unwrap().code(), code);
    }
    let bytes = written(&preambles()[3]);
    let columns = Limits { max_additional_columns: 1, ..Limits::default() };
    assert_eq!(open(Arc::new(bytes.clone()), &columns).err().unwrap().code(), "tm25.too_many_columns");
    let text = Limits { max_text_bytes: 32, ..Limits::default() };
    assert_eq!(open(Arc::new(bytes), &text).err().unwrap().code(), "tm25.long_text");
}
