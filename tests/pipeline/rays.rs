//! Ray files to sources: known sources with closed-form answers, damaged files, several files together.
#![expect(clippy::unwrap_used, reason = "clippy.toml allows it in #[test] functions only, and these are their tools")]

use glam::DVec3;
use pipeline::formats::bytes::digest;
use pipeline::formats::record::{Bytes, RawRay};
use pipeline::formats::tm25::Preamble;
use pipeline::formats::tm25::additional::Additional;
use pipeline::formats::tm25::header::{Flags, Header, SpectralId};
use pipeline::formats::tm25::spectra::Spectra;
use pipeline::formats::tm25::writer::Writer;
use pipeline::known_sources::{KnownSource, write_tm25};
use pipeline::options::RaysOptions;
use pipeline::source::{Columns, Ray, Source};
use pipeline::vocabulary::watch::StageWatch;
use pipeline::{
    Declared, Error, Format, Input, Limits, NoProgress, Place, Stage, Watch, header, inspect, known_sources, peek,
};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

fn input(bytes: Vec<u8>) -> Input {
    Input {
        name: "test".into(),
        sha256: digest(&bytes).unwrap(),
        bytes: Arc::new(bytes),
        declared: Declared::default(),
        notices: Vec::new(),
    }
}

fn read_with(files: &[Vec<u8>], options: &RaysOptions, watch: &dyn Watch) -> Result<Source, Error> {
    let inputs: Vec<Input> = files.iter().cloned().map(input).collect();
    Source::read(&inputs, options, &Limits::default(), StageWatch::enter(watch, Stage::Rays)?)
}

pub fn read_all(files: Vec<Vec<u8>>) -> Result<Source, Error> {
    read_with(&files, &RaysOptions::default(), &NoProgress)
}

fn refused(files: Vec<Vec<u8>>) -> &'static str {
    read_all(files).err().map_or("read", |error| error.code())
}

fn known(source: &KnownSource, rays: u64) -> Vec<u8> {
    let mut bytes = Vec::new();
    write_tm25(source, rays, 11, &mut bytes).unwrap();
    bytes
}

/// A TM-25 file without totals and with these rays.
pub fn file(flags: Flags, spectral_id: SpectralId, tables: Vec<Vec<(f32, f32)>>, rays: &[RawRay]) -> Vec<u8> {
    let header = Header { flags, spectral_id, ray_count: rays.len() as u64, ..Header::default() };
    let mut bytes = Vec::new();
    let preamble = Preamble::new(header, Spectra::new(tables), Additional::default());
    let mut writer = Writer::start(&mut bytes, &preamble).unwrap();
    let mut rows = Vec::new();
    rays.iter().for_each(|ray| writer.rows().encode(ray, &[], &mut rows));
    writer.write(&rows).unwrap();
    writer.finish().unwrap();
    bytes
}

/// One good ray: 2 W or 2 lm at 555 nm, up.
pub fn good() -> RawRay {
    RawRay { direction: [0.0, 0.0, 1.0], radiant: 2.0, luminous: 2.0, wavelength_nm: 555.0, ..RawRay::default() }
}

pub const WATTS: Flags =
    Flags { radiant: true, wavelength: false, luminous: false, stokes: false, tristimulus: false, index: false };
pub const LUMENS: Flags = Flags { radiant: false, luminous: true, ..WATTS };

/// Rays, W, lm and columns of one pass, as `[count, W, lm, columns..]`.
pub fn pass(source: &Source) -> Vec<f64> {
    let watch = StageWatch::enter(&NoProgress, Stage::Flux).unwrap();
    let columns = source.spectral.column_count();
    let add = |total: &mut Vec<f64>, part: Vec<f64>| total.iter_mut().zip(part).for_each(|(sum, more)| *sum += more);
    let work = |rays: &[Ray]| {
        let mut sums = vec![0.0; 3 + columns];
        for ray in rays {
            sums[0] += 1.0;
            sums[1] += ray.radiant_w;
            sums[2] += ray.luminous_lm;
            source.spectral.deposit(ray, |column, amount| sums[3 + column] += amount);
        }
        Ok(sums)
    };
    source.fold(watch, vec![0.0; 3 + columns], work, add).unwrap()
}

/// Rays seen and sums of W and lm of one pass.
pub fn sums(source: &Source) -> (u64, f64, f64) {
    let sums = pass(source);
    (sums[0] as u64, sums[1], sums[2])
}

pub fn close(a: f64, b: f64, relative: f64) -> bool {
    (a - b).abs() <= relative * b.abs()
}

#[test]
fn known_sources_keep_their_totals_and_bands() {
    const RAYS: u64 = 40_000;
    for truth in known_sources::all() {
        let source = read_all(vec![known(&truth, RAYS)]).unwrap();
        let sums = pass(&source);
        assert_eq!(sums[0], RAYS as f64);
        assert!(close(sums[1], truth.radiant_w(), 1e-6), "{}", truth.name);
        let bands = &source.spectral.bands;
        let density = source.spectral.bands_w_per_nm(&sums[3..]);
        for (band, watt) in truth.bands_w(bands).into_iter().enumerate() {
            let found = density[band] * bands.widths_nm()[band];
            let share = watt / truth.radiant_w();
            // Sampled wavelengths scatter by their binomial error (false alarm 6e-7 each); tables are exact but for f32.
            let scatter = truth.radiant_w() * (share * (1.0 - share) / RAYS as f64).sqrt();
            let allowed = if truth.has_one_spectrum() { 1e-6 } else { 5.0 * scatter + 1e-4 };
            assert!((found - watt).abs() <= allowed, "{} band {band}: {found} {watt}", truth.name);
        }
        // lm by V(λ) per ray scatter too; with one table they are the header's.
        let allowed = if truth.has_one_spectrum() { 1e-6 } else { 0.03 };
        assert!(close(sums[2], truth.luminous_lm(), allowed), "{}: {} {}", truth.name, sums[2], truth.luminous_lm());
        assert_eq!(source.notices.iter().count(), 0, "{}: {:?}", truth.name, source.notices);
        assert!(source.survey.bounds_mm.min.cmpge(truth.bounds_mm().min - 1e-6).all());
    }
}

#[test]
fn centroid_and_hemispheres_of_the_cylinder() {
    let truth = known_sources::by_name("cylinder").unwrap();
    let source = read_all(vec![known(&truth, 100_000)]).unwrap();
    // Uniform over 4 mm: standard error 4/√12/√n; half the flux each way: 0.5/√n.
    let z = (source.survey.centroid_mm.z - 2.0) / (4.0 / 12_f64.sqrt() / 100_000_f64.sqrt());
    assert!(z.abs() < 5.0, "{z}");
    for share in source.survey.directions.hemispheres() {
        assert!(((share - 0.5) / (0.5 / 100_000_f64.sqrt())).abs() < 5.0, "{share}");
    }
}

#[test]
fn one_thread_and_three_give_the_same_bits() {
    let file = known(&known_sources::by_name("four-chips").unwrap(), 200_000);
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let source = read_all(vec![file.clone()]).unwrap();
            (pass(&source), source.survey.centroid_mm, source.survey.directions.clone())
        })
    };
    assert!(on(1) == on(3));
    let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
    assert!(pool.install(|| known(&known_sources::by_name("four-chips").unwrap(), 200_000)) == file);
}

#[test]
fn what_is_wrong_with_rays_is_counted_with_its_first_offender() {
    let mut rays = vec![good(); 2000];
    let flaws: [(&str, usize, RawRay); 6] = [
        ("rays.not_finite", 5, RawRay { origin_mm: [f64::NAN, 0.0, 0.0], ..good() }),
        ("rays.not_finite", 900, RawRay { radiant: f64::INFINITY, ..good() }),
        ("rays.direction_length", 7, RawRay { direction: [0.0; 3], ..good() }),
        ("rays.flux_negative", 8, RawRay { radiant: -1.0, ..good() }),
        ("rays.flux_zero", 9, RawRay { radiant: 0.0, ..good() }),
        ("rays.direction_normalized", 10, RawRay { direction: [0.0, 0.0, 1.0005], ..good() }),
    ];
    flaws.iter().for_each(|(_, at, ray)| rays[*at] = *ray);
    let bytes = file(WATTS, SpectralId::None, vec![], &rays);
    let source = read_all(vec![bytes.clone()]).unwrap();
    assert_eq!(sums(&source), (1995, 3990.0, 0.0));
    assert_eq!(source.flux.luminous_lm, None, "no spectrum, no lumens");
    for (code, at, _) in &flaws {
        let notice = source.notices.iter().find(|notice| notice.code == *code).unwrap();
        let expected = if *code == "rays.not_finite" { (2, Some(5)) } else { (1, Some(*at as u64)) };
        assert_eq!((notice.count, notice.first_ray), expected);
    }
    let seen = inspect(&input(bytes), &Limits::default(), &NoProgress).unwrap();
    assert_eq!((seen.rays_used, seen.rays_refused, seen.rays_dropped), (1995, 4, 1));
    assert_eq!((seen.radiant_sum, seen.luminous_sum, seen.sum_over_header), (Some(3990.0), None, None));
    assert!(serde_json::to_string(&seen).unwrap().contains("\"rays.flux_zero\""));
}

#[test]
fn files_without_usable_rays_are_refused() {
    let bad = RawRay { direction: [0.0, 2.0, 0.0], ..good() };
    let dark = RawRay { radiant: 0.0, ..good() };
    let of = |rays: &[RawRay]| file(WATTS, SpectralId::None, vec![], rays);
    assert_eq!(refused(vec![of(&[])]), "rays.empty");
    assert_eq!(refused(vec![of(&[dark; 3])]), "rays.none_usable");
    assert_eq!(refused(vec![]), "rays.no_input");
    let mut rays = vec![good(); 100];
    rays[40] = bad;
    assert_eq!(refused(vec![of(&rays)]), "read", "one per cent is allowed");
    rays[30] = bad;
    let Err(Error::Refused(fault)) = read_all(vec![of(&rays)]) else { panic!("2 % were taken") };
    assert_eq!((fault.code, fault.at), ("rays.too_many_refused", Some(Place::Ray(30))));
}

/// 683 lm/W at 555 nm (V = 1), by wavelength, by single line, by table; nothing without a spectrum.
#[test]
fn lumens_and_watts_follow_from_a_spectrum_and_from_nothing_else() {
    let line = vec![vec![(555.0_f32, 1.0_f32)]];
    let per_ray = Flags { wavelength: true, ..WATTS };
    let lumens_per_ray = Flags { wavelength: true, ..LUMENS };
    let indexed = Flags { index: true, ..LUMENS };
    let cases = [
        (per_ray, SpectralId::PerRay, vec![], Some(2.0), Some(1366.0)),
        (lumens_per_ray, SpectralId::PerRay, vec![], Some(2.0 / 683.0), Some(2.0)),
        (LUMENS, SpectralId::OneTable, line.clone(), Some(2.0 / 683.0), Some(2.0)),
        (indexed, SpectralId::IndexPerRay, line, Some(2.0 / 683.0), Some(2.0)),
        (LUMENS, SpectralId::None, vec![], None, Some(2.0)),
        (WATTS, SpectralId::None, vec![], Some(2.0), None),
        (Flags { radiant: true, ..LUMENS }, SpectralId::None, vec![], Some(2.0), Some(2.0)),
    ];
    for (flags, id, tables, watt, lumen) in cases {
        let source = read_all(vec![file(flags, id, tables, &[good()])]).unwrap();
        let near = |found: Option<f64>, expected: Option<f64>| match (found, expected) {
            (Some(found), Some(expected)) => close(found, expected, 1e-9),
            (found, expected) => found == expected,
        };
        assert!(near(source.flux.radiant_w, watt) && near(source.flux.luminous_lm, lumen), "{id:?} {:?}", source.flux);
        let (_, summed_watt, summed_lumen) = sums(&source);
        assert!(close(summed_watt, watt.unwrap_or(0.0), 1e-9) && close(summed_lumen, lumen.unwrap_or(0.0), 1e-9));
    }
    let infrared = RawRay { wavelength_nm: 940.0, ..good() };
    assert_eq!(refused(vec![file(lumens_per_ray, SpectralId::PerRay, vec![], &[infrared])]), "rays.too_many_refused");
}

/// Rays are relative where the header has a total, whichever total it has; Zemax's header is not believed.
#[test]
fn the_headers_total_holds_in_tm25() {
    let of = |header: Header, table: Option<(f32, f32)>| {
        let header = Header { ray_count: 10, ..header };
        let tables = table.map(|point| vec![point]).into_iter().collect();
        let preamble = Preamble::new(header, Spectra::new(tables), Additional::default());
        let mut bytes = Vec::new();
        let mut writer = Writer::start(&mut bytes, &preamble).unwrap();
        let mut rows = Vec::new();
        (0..10).for_each(|_| writer.rows().encode(&good(), &[], &mut rows));
        writer.write(&rows).unwrap();
        let source = read_all(vec![bytes]).unwrap();
        let (_, watt, lumen) = sums(&source);
        assert!(close(watt, source.flux.radiant_w.unwrap_or(0.0), 1e-12));
        assert!(close(lumen, source.flux.luminous_lm.unwrap_or(0.0), 1e-12));
        // To 12 digits: sums round.
        let [watt, lumen] = [watt, lumen].map(|flux| (flux * 1e12).round() / 1e12);
        (watt, lumen, source.notices.count_of("rays.total_ratio"), source.notices.count_of("rays.efficacy_differs"))
    };
    let lumens = Header { flags: LUMENS, luminous_lm: Some(5.0), ..Header::default() };
    assert_eq!(of(lumens.clone(), None), (0.0, 5.0, 1, 0));
    // Both totals and one table: both hold, although the table says 683 lm/W.
    let both = Header { radiant_w: Some(0.25), spectral_id: SpectralId::OneTable, ..lumens };
    assert_eq!(of(both, Some((555.0, 1.0))), (0.25, 5.0, 1, 1));
    // W per ray, lm in the header: 683 lm/W at 555 nm make 6.83 lm of 0.01 W.
    let flags = Flags { wavelength: true, ..WATTS };
    let other = Header { flags, luminous_lm: Some(6.83), spectral_id: SpectralId::PerRay, ..Header::default() };
    let (watt, lumen, _, _) = of(other, None);
    assert!(close(watt, 0.01, 1e-6) && close(lumen, 6.83, 1e-6));
    // Both columns, one total: one factor for both.
    let flags = Flags { radiant: true, ..LUMENS };
    let half = Header { flags, radiant_w: Some(10.0), ..Header::default() };
    assert_eq!(of(half, None), (10.0, 10.0, 1, 0));
}

/// Damage of any kind is an answer, never a panic: 4 000 files with one word of header or tables replaced.
#[test]
fn damaged_files_are_read_or_refused() {
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::{Rng, SeedableRng};
    let tables = vec![vec![(440.0, 0.5), (450.0, 1.0)], vec![(620.0, 0.5), (650.0, 1.0)]];
    let flags = Flags { index: true, ..WATTS };
    let whole = file(flags, SpectralId::IndexPerRay, tables, &[good(); 3]);
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let (mut read, mut refused) = (0, 0);
    for _ in 0..4000 {
        let mut bytes = whole.clone();
        let spots = (0..72).chain(36_288 / 4..bytes.len() / 4).collect::<Vec<usize>>();
        let at = 4 * spots[random.next_u32() as usize % spots.len()];
        let word = match random.next_u32() % 4 {
            0 => random.next_u32(),
            1 => random.next_u32() % 40,
            2 => u32::MAX - random.next_u32() % 4,
            _ => 0x7f80_0000 + random.next_u32() % 2,
        };
        bytes[at..at + 4].copy_from_slice(&word.to_le_bytes());
        match read_all(vec![bytes]) {
            Ok(source) => {
                read += 1;
                assert!(pass(&source).iter().all(|sum| sum.is_finite()), "word {word:#x} at {at}");
            }
            Err(_) => refused += 1,
        }
    }
    assert!(read > 400 && refused > 400, "{read} read, {refused} refused");
}

#[test]
fn tristimulus_rays_are_three_columns() {
    let flags = Flags { tristimulus: true, ..LUMENS };
    let ray = RawRay { xz: [1.5, 0.25], ..good() };
    let source = read_all(vec![file(flags, SpectralId::None, vec![], &[ray, ray])]).unwrap();
    assert!(matches!(source.spectral.columns, Columns::Tristimulus));
    assert_eq!(pass(&source), [2.0, 0.0, 4.0, 3.0, 4.0, 0.5]);
}

#[test]
fn bands_follow_the_rays_or_the_user() {
    let at = |nm: f64| RawRay { wavelength_nm: nm, ..good() };
    let flags = Flags { wavelength: true, ..WATTS };
    let of = |rays: &[RawRay]| file(flags, SpectralId::PerRay, vec![], rays);
    let ends = |source: &Source| {
        let edges = source.spectral.bands.edges_nm();
        (edges[0], edges[edges.len() - 1], edges.len() - 1)
    };
    let plain = read_all(vec![of(&[at(555.0)])]).unwrap();
    assert_eq!(ends(&plain), (380.0, 780.0, 40));
    let wide = read_all(vec![of(&[at(272.0), at(1064.0)])]).unwrap();
    assert_eq!(ends(&wide), (270.0, 1070.0, 80));
    assert_eq!(wide.notices.iter().count(), 0);
    let absurd = read_all(vec![of(&[at(555.0), at(30_000.0)])]).unwrap();
    assert_eq!(ends(&absurd), (380.0, 780.0, 40));
    assert_eq!(absurd.notices.count_of("rays.bands_not_widened"), 1);
    assert_eq!(absurd.notices.count_of("rays.outside_bands"), 1);
    let options = |edges: &[f64]| RaysOptions { band_edges_nm: Some(edges.to_vec()), ..RaysOptions::default() };
    let asked = read_with(&[of(&[at(555.0), at(700.0)])], &options(&[500.0, 600.0, 650.0]), &NoProgress).unwrap();
    assert_eq!(pass(&asked), [2.0, 4.0, asked.flux.luminous_lm.unwrap(), 2.0, 0.0, 2.0]);
    assert_eq!(asked.notices.count_of("rays.outside_bands"), 1);
    for edges in [&[500.0][..], &[600.0, 500.0], &[-1.0, 500.0], &[f64::NAN, 500.0]] {
        let error = read_with(&[of(&[good()])], &options(edges), &NoProgress).err().unwrap();
        assert!(matches!(&error, Error::Unusable(_)) && error.code() == "options.band_edges");
    }
}

/// Cancels at the given call.
struct Impatient {
    calls: AtomicU64,
    patience: u64,
}

impl Watch for Impatient {
    fn progress(&self, _stage: Stage, fraction: f64) {
        assert!((0.0..=1.0).contains(&fraction));
    }
    fn cancelled(&self) -> bool {
        self.calls.fetch_add(1, Ordering::Relaxed) >= self.patience
    }
}

#[test]
fn cancellation_reaches_every_chunk() {
    let file = known(&known_sources::by_name("flat-chip").unwrap(), 100_000);
    for patience in 0..5 {
        let watch = Impatient { calls: AtomicU64::new(0), patience };
        let answer = read_with(std::slice::from_ref(&file), &RaysOptions::default(), &watch);
        assert!(matches!(answer, Err(Error::Cancelled)), "{patience}");
    }
}

/// Bytes whose medium fails behind the header.
struct Broken(Vec<u8>);

impl Bytes for Broken {
    fn len(&self) -> u64 {
        self.0.len() as u64
    }
    fn read_at(&self, offset: u64, into: &mut [u8]) -> std::io::Result<()> {
        if offset > 40_000 { Err(std::io::Error::other("disk on fire")) } else { self.0.read_at(offset, into) }
    }
}

#[test]
fn a_failing_medium_is_told() {
    let bytes = Broken(known(&known_sources::by_name("flat-chip").unwrap(), 40_000));
    let input = Input {
        name: "test".into(),
        sha256: String::new(),
        bytes: Arc::new(bytes),
        declared: Declared::default(),
        notices: Vec::new(),
    };
    let error = inspect(&input, &Limits::default(), &NoProgress).err().unwrap();
    assert!(error.to_string().contains("disk on fire"), "{error}");
}

#[test]
fn the_first_bytes_tell_as_much_as_they_can() {
    let limits = Limits::default();
    let bytes = known(&known_sources::by_name("flat-chip").unwrap(), 100);
    let length = bytes.len() as u64;
    for known in [None, Some(length)] {
        assert_eq!(peek(&bytes[..3], known, &limits).unwrap(), None);
        for end in [4, 100, 300, 36_288, bytes.len()] {
            assert_eq!(peek(&bytes[..end], known, &limits).unwrap(), Some(Format::Tm25));
        }
    }
    assert_eq!(peek(&bytes[..36_288], Some(length - 2000), &limits).unwrap_err().code(), "tm25.size");
    let mut wrong = bytes[..36_288].to_vec();
    wrong[256] = 0;
    assert_eq!(peek(&wrong, None, &limits).unwrap_err().code(), "tm25.no_rays");
    assert_eq!(peek(b"LTRF....", Some(9_000_000_000), &limits).unwrap(), Some(Format::LightToolsBinary));
    let third = [*b"LTRF", [3, 0, 0, 0]].concat().into_iter().chain([0; 40]).collect::<Vec<u8>>();
    assert_eq!(peek(&third, None, &limits).unwrap_err().code(), "lighttools.polarised");
    assert_eq!(peek(&bytes[..36_288], None, &Limits { max_rays: 99, ..limits }).unwrap_err().code(), "rays.too_many");
    let told = header(&input(bytes), &limits).unwrap();
    assert_eq!((told.format, told.ray_count, told.flux.radiant_w), (Format::Tm25, 100, Some(1.0)));
}

#[test]
fn turned_sources_look_where_they_were_turned() {
    use pipeline::vocabulary::space::Axis;
    for (k, axis) in Axis::ALL.into_iter().enumerate() {
        let truth = known_sources::by_name("flat-chip").unwrap().rotate(axis);
        let source = read_all(vec![known(&truth, 1000)]).unwrap();
        assert_eq!(source.survey.directions.hemispheres()[k], 1.0);
        assert_eq!(source.survey.bounds_mm.size().dot(axis.vector().abs()), 0.0);
        assert!(source.survey.bounds_mm.size().cmple(DVec3::ONE).all());
    }
}
