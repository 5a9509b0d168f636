//! Writing and reading are each other's inverse: what is drawn from a seed comes back as it was, and the bytes we wrote are the
//! bytes we write of what was read from them.

use pipeline::formats::lighttools::writer as lighttools;
use pipeline::formats::record::{Facts, RawRay, SpectralData};
use pipeline::formats::tm25;
use pipeline::formats::tm25::additional::Additional;
use pipeline::formats::tm25::header::{Flags, Header, SpectralId};
use pipeline::formats::tm25::spectra::Spectra;
use pipeline::formats::tm25::{Preamble, read_preamble};
use pipeline::formats::writer::Encode;
use pipeline::formats::zemax::writer;
use pipeline::formats::zemax::writer::Rows;
use pipeline::rays::declared::open;
use pipeline::vocabulary::notice::Notices;
use pipeline::{Declared, Limits};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use std::sync::Arc;

/// Files drawn per format; each covers every spectral identifier or kind of row.
const FILES: u64 = 40;

/// Numbers of all sorts from a seed.
struct Draw(ChaCha8Rng);

impl Draw {
    fn new(seed: u64) -> Draw {
        Draw(ChaCha8Rng::seed_from_u64(seed))
    }

    fn below(&mut self, end: u32) -> u32 {
        self.0.next_u32() % end
    }

    fn yes(&mut self) -> bool {
        self.below(2) == 1
    }

    /// Any finite binary32: denormals, both zeros, huge and tiny ones.
    fn number(&mut self) -> f64 {
        loop {
            let value = f32::from_bits(self.0.next_u32());
            if value.is_finite() {
                return value.into();
            }
        }
    }

    /// A positive number that no writer means as "unknown" (pipeline/formats/README.md 1).
    fn total(&mut self) -> Option<f64> {
        self.yes().then(|| f64::from(f32::from_bits(0x3000_0000 + self.below(0x2000_0000))))
    }

    /// Text of up to `most` code points from all over Unicode, without white space at its ends.
    fn text(&mut self, most: u32) -> String {
        const SIGNS: [char; 9] = ['a', 'Z', ' ', 'ß', 'Ω', '光', '🔦', '~', '\u{10FFFF}'];
        let count = self.below(most + 1);
        let text: String = (0..count).map(|_| SIGNS[self.below(9) as usize]).collect();
        text.trim().to_owned()
    }

    fn numbers<const N: usize>(&mut self) -> [f64; N] {
        std::array::from_fn(|_| self.number())
    }
}

/// A preamble with this identifier and everything else drawn.
fn preamble(draw: &mut Draw, spectral_id: SpectralId) -> Preamble {
    let tables = match spectral_id {
        SpectralId::OneTable => 1,
        SpectralId::IndexPerRay => 1 + draw.below(5),
        _ => 0,
    };
    let radiant = draw.yes() || matches!(spectral_id, SpectralId::PerRay | SpectralId::IndexPerRay);
    let luminous = !radiant || draw.yes();
    let flags = Flags {
        radiant,
        wavelength: spectral_id == SpectralId::PerRay,
        luminous,
        stokes: radiant && draw.yes(),
        tristimulus: luminous && spectral_id == SpectralId::None && draw.yes(),
        index: spectral_id == SpectralId::IndexPerRay,
    };
    let points = (0..tables).map(|_| {
        // Wavelengths of light in nm; others would be taken for another unit, or for no spectrum.
        let start = draw.below(300) as f32 + 100.1;
        (0..=draw.below(9)).map(|k| (start + 7.3 * k as f32, 0.25 + draw.below(1000) as f32 / 3.0)).collect()
    });
    let points = points.collect();
    let header = Header {
        creation_method: draw.0.next_u32() as i32,
        luminous_lm: draw.total(),
        radiant_w: draw.total(),
        ray_count: 1 + u64::from(draw.below(20)),
        date: "2026-01-02T03:04:05Z".chars().take(draw.below(21) as usize).collect(),
        start_position: draw.0.next_u32() as i32,
        spectral_id,
        wavelength_nm: if spectral_id == SpectralId::One { Some(555.5) } else { draw.total() },
        range_nm: [draw.total(), draw.total()],
        flags,
        texts: std::array::from_fn(|_| draw.text(999)),
        ..Header::default()
    };
    let columns = (0..draw.below(4)).map(|_| draw.text(127)).collect();
    Preamble::new(header, Spectra::new(points), Additional { columns, text: draw.text(300) })
}

/// Rays with exactly what `flags` says, and their additional numbers.
fn rays(draw: &mut Draw, preamble: &Preamble) -> Vec<(RawRay, Vec<f32>)> {
    let Preamble { header, spectra, additional } = preamble;
    let flags = header.flags;
    let mut drawn = Vec::new();
    for _ in 0..header.ray_count {
        let [radiant, luminous, x, z] = draw.numbers();
        let wavelength_nm = f64::from(draw.below(1_000_000) as f32 / 64.0 + 100.0);
        let kept = |present: bool, value: f64| if present { value } else { 0.0 };
        let ray = RawRay {
            origin_mm: draw.numbers(),
            direction: draw.numbers(),
            radiant: kept(flags.radiant, radiant),
            luminous: kept(flags.luminous, luminous),
            wavelength_nm: kept(flags.wavelength, wavelength_nm),
            table: if flags.index { draw.below(spectra.points.len() as u32) } else { 0 },
            xz: [kept(flags.tristimulus, x), kept(flags.tristimulus, z)],
        };
        drawn.push((ray, additional.columns.iter().map(|_| draw.number() as f32).collect()));
    }
    drawn
}

fn tm25_bytes(preamble: &Preamble, rays: &[(RawRay, Vec<f32>)]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut writer = tm25::writer::Writer::start(&mut bytes, preamble).unwrap();
    for (ray, additional) in rays {
        let mut row = Vec::new();
        writer.rows().encode(ray, additional, &mut row);
        assert_eq!(row.len(), writer.rows().row_bytes());
        writer.write(&row).unwrap();
    }
    writer.finish().unwrap();
    bytes
}

fn opened(bytes: &[u8]) -> (Facts, Vec<RawRay>) {
    let set = open(Arc::new(bytes.to_vec()), &Declared::default(), &Limits::default()).unwrap();
    let mut rays = Vec::new();
    set.records.read(0, set.facts.ray_count as usize, &mut rays).unwrap();
    (set.facts, rays)
}

#[test]
fn tm25_is_read_as_it_was_written_and_written_as_it_was_read() {
    for seed in 0..FILES {
        for spectral_id in SpectralId::ALL {
            let mut draw = Draw::new(seed);
            let preamble = preamble(&mut draw, spectral_id);
            let rays = rays(&mut draw, &preamble);
            let bytes = tm25_bytes(&preamble, &rays);

            let mut notices = Notices::default();
            let (read, layout) = read_preamble(&bytes, &Limits::default(), &mut notices).unwrap();
            assert_eq!(read, preamble, "seed {seed}");
            assert_eq!(notices, Notices::default(), "seed {seed}");
            let (_, found) = opened(&bytes);
            assert!(found.iter().eq(rays.iter().map(|(ray, _)| ray)), "seed {seed}, {spectral_id:?}");

            // The reader gives additional columns no meaning: they are the last numbers of each row (pipeline/formats/README.md 1).
            let rows = bytes[layout.start() as usize..].chunks_exact(layout.record_bytes() as usize);
            let additional = rows.map(|row| {
                let own = &row[row.len() - 4 * preamble.additional.columns.len()..];
                own.chunks_exact(4).map(|word| f32::from_le_bytes(word.try_into().unwrap())).collect::<Vec<f32>>()
            });
            let again: Vec<(RawRay, Vec<f32>)> = found.iter().copied().zip(additional).collect();
            assert!(tm25_bytes(&read, &again) == bytes, "seed {seed}, {spectral_id:?}: other bytes");
        }
    }
}

fn zemax_bytes(header: &writer::Header, rays: &[RawRay]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut writer = writer::Writer::start(&mut bytes, header).unwrap();
    let mut rows = Vec::new();
    rays.iter().for_each(|ray| writer.rows().encode_ray(ray, &mut rows));
    writer.write(&rows).unwrap();
    writer.finish().unwrap();
    bytes
}

/// The header that was read, from what the reader tells of it.
fn zemax_header(facts: &Facts) -> writer::Header {
    let text = |name: &str| facts.texts.iter().find(|(own, _)| own == name).unwrap().1.clone();
    let rows = match (&facts.spectral, facts.has_luminous) {
        (SpectralData::Wavelength, _) => Rows::Spectral,
        (_, true) => Rows::Luminous,
        _ => Rows::Radiant,
    };
    writer::Header {
        ray_count: facts.ray_count.try_into().unwrap(),
        description: text("description"),
        flux: facts.header_flux.primary(),
        wavelength_nm: facts.spectral.tables().first().map(|table| table.range_nm().0),
        rows,
    }
}

#[test]
fn zemax_is_read_as_it_was_written_and_written_as_it_was_read() {
    for seed in 0..FILES {
        for rows in [Rows::Radiant, Rows::Luminous, Rows::Spectral] {
            let mut draw = Draw::new(1000 + seed);
            let um = |draw: &mut Draw| f64::from(0.3 + draw.below(1_000_000) as f32 / 1e6) * 1000.0;
            let rays: Vec<RawRay> = (0..=draw.below(30))
                .map(|_| RawRay {
                    origin_mm: draw.numbers(),
                    direction: draw.numbers(),
                    radiant: if rows == Rows::Luminous { 0.0 } else { draw.number() },
                    luminous: if rows == Rows::Luminous { draw.number() } else { 0.0 },
                    wavelength_nm: if rows == Rows::Spectral { um(&mut draw) } else { 0.0 },
                    ..RawRay::default()
                })
                .collect();
            let header = writer::Header {
                ray_count: rays.len() as u32,
                description: draw.text(100).chars().filter(char::is_ascii).collect::<String>().trim().to_owned(),
                flux: draw.total().unwrap_or(1.5),
                wavelength_nm: (rows != Rows::Spectral && draw.yes()).then(|| um(&mut draw)),
                rows,
            };
            let bytes = zemax_bytes(&header, &rays);
            let (facts, found) = opened(&bytes);
            assert_eq!(found, rays, "seed {seed}");
            assert_eq!(zemax_header(&facts), header, "seed {seed}");
            assert!(zemax_bytes(&zemax_header(&facts), &found) == bytes, "seed {seed}: other bytes");
        }
    }
}

/// The fields OpticStudio reads, at the places its help page gives (pipeline/formats/README.md 2).
#[test]
fn a_zemax_file_by_the_vendors_table() {
    let ray = RawRay {
        origin_mm: [1.0, 2.0, 3.0],
        direction: [0.0, 0.0, 1.0],
        radiant: 0.25,
        wavelength_nm: 500.0,
        ..RawRay::default()
    };
    let header = writer::Header {
        ray_count: 1,
        description: "d".repeat(150),
        flux: 0.25,
        wavelength_nm: None,
        rows: Rows::Spectral,
    };
    let bytes = zemax_bytes(&header, &[ray]);
    assert_eq!(bytes.len(), 208 + 32);
    let word = |at: usize| i32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
    assert_eq!([0, 4, 136, 192, 196].map(word), [1010, 1, 4, 2, 0]);
    assert!(bytes[8..108].iter().all(|byte| *byte == b'd') && bytes[120..136].iter().all(|byte| *byte == 0));
    let numbers: Vec<f32> =
        bytes[208..].chunks_exact(4).map(|word| f32::from_le_bytes(word.try_into().unwrap())).collect();
    assert_eq!(numbers, [1.0, 2.0, 3.0, 0.0, 0.0, 1.0, 0.25, 0.5]);
}

fn lighttools_bytes(header: &lighttools::Header, rays: &[RawRay]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut writer = lighttools::Writer::start(&mut bytes, header).unwrap();
    let mut rows = Vec::new();
    rays.iter().for_each(|ray| writer.rows().encode_ray(ray, &mut rows));
    writer.write(&rows).unwrap();
    writer.finish().unwrap();
    bytes
}

/// The header that was read, from what the reader tells of it.
fn lighttools_header(facts: &Facts) -> lighttools::Header {
    let color = match facts.spectral {
        SpectralData::Tristimulus => lighttools::Color::Tristimulus,
        SpectralData::Wavelength => lighttools::Color::Wavelength,
        _ => lighttools::Color::None,
    };
    let rows = lighttools::Rows { luminous: facts.has_luminous, color };
    lighttools::Header { ray_count: facts.ray_count, flux: facts.header_flux.primary(), rows }
}

#[test]
fn lighttools_is_read_as_it_was_written_and_written_as_it_was_read() {
    use lighttools::Color;
    let kinds = [
        (false, Color::None),
        (true, Color::None),
        (false, Color::Wavelength),
        (true, Color::Wavelength),
        (true, Color::Tristimulus),
    ];
    for seed in 0..FILES {
        for (luminous, color) in kinds {
            let mut draw = Draw::new(2000 + seed);
            let rays: Vec<RawRay> = (0..=draw.below(30))
                .map(|_| RawRay {
                    origin_mm: draw.numbers(),
                    direction: draw.numbers(),
                    radiant: if luminous { 0.0 } else { draw.number() },
                    luminous: if luminous { draw.number() } else { 0.0 },
                    wavelength_nm: match color {
                        Color::Wavelength => f64::from(draw.below(1_000_000) as f32 / 64.0 + 100.0),
                        _ => 0.0,
                    },
                    xz: if color == Color::Tristimulus { draw.numbers() } else { [0.0; 2] },
                    ..RawRay::default()
                })
                .collect();
            let rows = lighttools::Rows { luminous, color };
            let flux = draw.total().unwrap_or(1.5);
            let header = lighttools::Header { ray_count: rays.len() as u64, flux, rows };
            let bytes = lighttools_bytes(&header, &rays);
            let (facts, found) = opened(&bytes);
            assert_eq!(found, rays, "seed {seed}");
            assert_eq!(facts.notices, Notices::default());
            assert_eq!(lighttools_header(&facts), header, "seed {seed}");
            assert!(lighttools_bytes(&lighttools_header(&facts), &found) == bytes, "seed {seed}: other bytes");
        }
    }
}

/// Every field at its place (pipeline/formats/README.md 3).
#[test]
fn a_lighttools_file_by_its_table() {
    let ray = RawRay {
        origin_mm: [1.0, 2.0, 3.0],
        direction: [0.0, 0.0, 1.0],
        luminous: 0.25,
        wavelength_nm: 500.0,
        ..RawRay::default()
    };
    let rows = lighttools::Rows { luminous: true, color: lighttools::Color::Wavelength };
    let bytes = lighttools_bytes(&lighttools::Header { ray_count: 1, flux: 0.25, rows }, &[ray]);
    assert!(bytes.starts_with(b"LTRF") && bytes.ends_with(b"LTRFEND"));
    assert_eq!(bytes.len(), 44 + 32 + 7);
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
    assert_eq!([4, 8, 12, 16, 20, 24, 28, 32, 36].map(word), [2, 0, 1, 0, 2, 1, 0, 0, 0]);
    let numbers: Vec<f32> =
        bytes[40..76].chunks_exact(4).map(|word| f32::from_le_bytes(word.try_into().unwrap())).collect();
    assert_eq!(numbers, [0.25, 1.0, 2.0, 3.0, 0.0, 0.0, 1.0, 0.25, 500.0]);
}
