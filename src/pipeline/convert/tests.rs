//! Files laid out here against what becomes of them; expected numbers are the files' own.

use super::light::text;
use super::*;
use crate::formats::bytes::digest;
use crate::formats::record::SpectralData;
use crate::formats::tm25::Preamble;
use crate::formats::tm25::additional::Additional;
use crate::formats::tm25::header::{Flags, Header, SpectralId};
use crate::formats::tm25::spectra::Spectra;
use crate::known_sources::{by_name, write_tm25};
use crate::rays::declared::open;
use crate::vocabulary::declaration::{Declared, FluxOverride};
use crate::vocabulary::spectrum::Table;
use crate::vocabulary::watch::{NoProgress, Stage};
use std::io::{Cursor, Read, Seek, SeekFrom, Write};
use std::sync::Arc;

fn input(bytes: Vec<u8>) -> Input {
    let sha256 = digest(&bytes).unwrap();
    Input {
        name: "lamp.ray".into(),
        sha256,
        bytes: Arc::new(bytes),
        declared: Declared::default(),
        notices: Vec::new(),
    }
}

fn converted(bytes: Vec<u8>, target: Target) -> Result<(Vec<u8>, Converted), Error> {
    written(&[input(bytes)], &Wanted::all(target))
}

fn written(inputs: &[Input], wanted: &Wanted) -> Result<(Vec<u8>, Converted), Error> {
    let mut out = Cursor::new(Vec::new());
    let watch = StageWatch::enter(&NoProgress, Stage::Rays)?;
    match convert(inputs, wanted, &Limits::default(), &mut out, watch) {
        Ok(told) => Ok((out.into_inner(), told)),
        Err(Failed::Read(error)) => Err(error),
        Err(Failed::Write(error)) => panic!("{error}"),
    }
}

fn codes(told: &Converted) -> Vec<&str> {
    told.notices.iter().map(|notice| notice.code.as_ref()).collect()
}

fn sample(name: &str, rays: u64) -> Vec<u8> {
    let mut bytes = Vec::new();
    write_tm25(&by_name(name).unwrap(), rays, 5, &mut bytes).unwrap();
    bytes
}

const TARGETS: [Target; 3] = [Target::Tm25, Target::ZemaxBinary, Target::LightToolsBinary];
const W: Flags =
    Flags { radiant: true, wavelength: false, luminous: false, stokes: false, tristimulus: false, index: false };

/// A TM-25 file of these rays.
fn file(header: Header, tables: Vec<Vec<(f32, f32)>>, additional: Additional, rays: &[RawRay]) -> Vec<u8> {
    let preamble = Preamble::new(Header { ray_count: rays.len() as u64, ..header }, Spectra::new(tables), additional);
    let mut bytes = Vec::new();
    let mut writer = Writer::<to_tm25::Rows>::start(&mut bytes, &preamble).unwrap();
    let mut rows = Vec::new();
    rays.iter().for_each(|ray| writer.rows().encode_ray(ray, &mut rows));
    writer.write(&rows).unwrap();
    writer.finish().unwrap();
    bytes
}

fn up(flux: f64) -> RawRay {
    RawRay {
        origin_mm: [0.1_f32, 0.2, 0.3].map(f64::from),
        direction: [0.0, 0.6_f32, 0.8].map(f64::from),
        radiant: flux,
        luminous: 100.0 * flux,
        wavelength_nm: 555.0,
        table: 1,
        xz: [50.0 * flux, 25.0 * flux],
    }
}

fn rays_of(bytes: &[u8]) -> Vec<RawRay> {
    open(Arc::new(bytes.to_vec()), &Declared::default(), &Limits::default()).unwrap().read_all().unwrap().1
}

#[test]
fn a_file_of_ours_to_its_own_format_is_the_same_bytes() {
    let chip = sample("flat-chip", 40_000);
    let (again, told) = converted(chip.clone(), Target::Tm25).unwrap();
    assert!(again == chip, "not the same bytes");
    assert_eq!((told.formats, told.rays_read, told.rays_written), (vec![Format::Tm25], 40_000, 40_000));
    // Where the rays have wavelengths, the header's range becomes that of the rays; then all stays.
    for target in TARGETS {
        let (once, _) = converted(sample("four-chips", 20_000), target).unwrap();
        let (twice, told) = converted(once.clone(), target).unwrap();
        assert!(twice == once, "{target:?}");
        assert_eq!(told.notices, []);
    }
}

#[test]
fn rays_go_to_another_format_and_back_to_the_last_digit() {
    let chip = sample("flat-chip", 20_000);
    for (target, format, bytes) in [
        (Target::ZemaxBinary, Format::ZemaxBinary, 208 + 28 * 20_000),
        (Target::LightToolsBinary, Format::LightToolsBinary, 44 + 28 * 20_000 + 7),
    ] {
        let (there, told) = converted(chip.clone(), target).unwrap();
        assert_eq!(codes(&told), ["convert.luminous_left_out", "convert.spectrum_left_out"]);
        assert!(told.notices[0].message.contains("27."), "the lumens that are lost: {:?}", told.notices);
        assert_eq!(there.len(), bytes);
        let (back, told) = converted(there, Target::Tm25).unwrap();
        assert_eq!(told.formats, [format]);
        assert!(rays_of(&back) == rays_of(&chip));
        assert!((told.flux_out.radiant_w.unwrap() - 1.0).abs() < 1e-6 && told.flux_out.luminous_lm.is_none());
    }
}

#[test]
fn relative_rays_are_scaled_to_the_headers_total_and_useless_ones_left_out() {
    let header = Header { radiant_w: Some(5.0), flags: W, ..Header::default() };
    let mut rays = vec![up(1.0); 200];
    rays[7].radiant = 0.0;
    rays[9].direction = [2.0, 0.0, 0.0];
    let bytes = file(header, Vec::new(), Additional::default(), &rays);
    for target in TARGETS {
        let (out, told) = converted(bytes.clone(), target).unwrap();
        let rays = rays_of(&out);
        assert_eq!((told.rays_read, told.rays_written, rays.len()), (200, 198, 198));
        assert_eq!(f64::from((5.0 / 198.0) as f32), rays[0].radiant);
        assert!((told.flux_out.radiant_w.unwrap() - 5.0).abs() < 1e-6);
        assert_eq!(told.flux_in.radiant_w, Some(5.0));
        assert_eq!(codes(&told), ["rays.direction_length", "rays.flux_zero", "rays.total_ratio"]);
    }
}

#[test]
fn tm25_keeps_every_kind_of_spectrum() {
    let tables = [vec![(440.0, 0.5), (450.0, 1.0)], vec![(620.0, 0.5), (650.0, 1.0)]];
    let kinds = [
        (SpectralId::None, Flags { luminous: true, tristimulus: true, ..W }, 0),
        (SpectralId::One, W, 0),
        (SpectralId::PerRay, Flags { wavelength: true, ..W }, 0),
        (SpectralId::OneTable, Flags { luminous: true, ..W }, 1),
        (SpectralId::IndexPerRay, Flags { index: true, ..W }, 2),
    ];
    for (spectral_id, flags, count) in kinds {
        let wavelength_nm = (spectral_id == SpectralId::One).then_some(555.0);
        let header = Header { spectral_id, flags, wavelength_nm, radiant_w: Some(3.0), ..Header::default() };
        let bytes = file(header, tables[..count].to_vec(), Additional::default(), &[up(1.0), up(2.0)]);
        let (out, told) = converted(bytes.clone(), Target::Tm25).unwrap();
        assert_eq!(rays_of(&out), rays_of(&bytes), "{spectral_id:?}");
        let [before, after] =
            [bytes, out].map(|bytes| open(Arc::new(bytes), &Declared::default(), &Limits::default()).unwrap().facts);
        assert_eq!(after.spectral, before.spectral);
        assert_eq!((after.has_radiant, after.has_luminous), (before.has_radiant, before.has_luminous));
        assert_eq!(told.flux_out.radiant_w, Some(3.0));
    }
}

#[test]
fn what_a_target_cannot_hold_is_refused_or_told() {
    let tables = vec![vec![(440.0, 0.5), (450.0, 1.0)], vec![(620.0, 0.5), (650.0, 1.0)]];
    let header = |spectral_id, flags| Header { spectral_id, flags, ..Header::default() };
    let rays = [up(1.0), up(2.0)];
    let index = header(SpectralId::IndexPerRay, Flags { index: true, ..W });
    let xyz = header(SpectralId::None, Flags { radiant: false, luminous: true, tristimulus: true, ..W });
    for bytes in [
        file(index.clone(), tables.clone(), Additional::default(), &rays),
        file(xyz, Vec::new(), Additional::default(), &rays),
    ] {
        assert_eq!(converted(bytes, Target::ZemaxBinary).unwrap_err().code(), "zemax.color_per_ray");
    }
    assert_eq!(
        converted(file(index, tables, Additional::default(), &rays), Target::LightToolsBinary).unwrap_err().code(),
        "lighttools.color_per_ray"
    );
    let both = header(SpectralId::None, Flags { luminous: true, ..W });
    let (_, told) = converted(file(both, Vec::new(), Additional::default(), &rays), Target::ZemaxBinary).unwrap();
    assert_eq!(told.notices[0].code, "convert.luminous_left_out");
    assert_eq!(told.flux_out, Flux { radiant_w: Some(3.0), luminous_lm: None });
    let columns = Additional { columns: vec!["phase".into()], text: "kept".into() };
    let (out, told) = converted(file(header(SpectralId::None, W), Vec::new(), columns, &rays), Target::Tm25).unwrap();
    assert_eq!(told.notices[0].code, "convert.additional_columns");
    let facts = open(Arc::new(out), &Declared::default(), &Limits::default()).unwrap().facts;
    assert_eq!(text(&facts, "additional_text"), "kept");
}

/// A stream that is full after so many bytes, and holds nothing.
struct Full(usize);

impl Read for Full {
    fn read(&mut self, _: &mut [u8]) -> io::Result<usize> {
        Ok(0)
    }
}

impl Seek for Full {
    fn seek(&mut self, _: SeekFrom) -> io::Result<u64> {
        Ok(0)
    }
}

impl Write for Full {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0 = self.0.checked_sub(bytes.len()).ok_or(io::ErrorKind::StorageFull)?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[test]
fn a_full_disk_is_the_streams_answer_and_not_the_files() {
    let input = input(sample("flat-chip", 40_000));
    for room in [100, 40_000, 600_000] {
        let watch = StageWatch::enter(&NoProgress, Stage::Rays).unwrap();
        let inputs = std::slice::from_ref(&input);
        let done = convert(inputs, &Wanted::all(Target::Tm25), &Limits::default(), &mut Full(room), watch);
        assert!(matches!(done, Err(Failed::Write(error)) if error.kind() == io::ErrorKind::StorageFull), "{room}");
    }
}

/// Two kinds of tristimulus and wavelengths in lm that only a LightTools file has room for beside TM-25.
#[test]
fn lighttools_keeps_wavelengths_and_tristimulus_values() {
    let xyz = Header { flags: Flags { radiant: false, luminous: true, tristimulus: true, ..W }, ..Header::default() };
    let bytes = file(xyz, Vec::new(), Additional::default(), &[up(1.0), up(2.0)]);
    let (out, told) = converted(bytes.clone(), Target::LightToolsBinary).unwrap();
    assert_eq!(rays_of(&out), rays_of(&bytes));
    assert_eq!(told.flux_out, Flux { radiant_w: None, luminous_lm: Some(300.0) });
    let one = Header { spectral_id: SpectralId::One, wavelength_nm: Some(555.0), flags: W, ..Header::default() };
    let (out, told) =
        converted(file(one, Vec::new(), Additional::default(), &[up(1.0)]), Target::LightToolsBinary).unwrap();
    assert_eq!((rays_of(&out)[0].wavelength_nm, told.notices), (555.0, Vec::new()));
}

/// Channels of `rays` rays each, of flux 1 W in all.
fn channel(name: &str, rays: u64, seed: u64, declared: Declared) -> Input {
    let mut bytes = Vec::new();
    write_tm25(&by_name("flat-chip").unwrap(), rays, seed, &mut bytes).unwrap();
    Input { name: name.into(), declared, ..input(bytes) }
}

fn with_flux(flux: FluxOverride) -> Declared {
    Declared { flux: Some(flux), ..Declared::default() }
}

fn wanted(target: Target) -> Wanted {
    Wanted::all(target)
}

/// Shares of a total: each ray of the channels has its part of it, one channel after the other.
#[test]
fn channels_are_joined_with_their_shares() {
    let inputs = [
        channel("a", 1000, 1, with_flux(FluxOverride::RadiantShare(0.75))),
        channel("b", 3000, 2, with_flux(FluxOverride::RadiantShare(0.25))),
    ];
    for target in TARGETS {
        let all = Wanted { total: Some(Total::RadiantW(8.0)), ..wanted(target) };
        let (out, told) = written(&inputs, &all).unwrap();
        let rays = rays_of(&out);
        assert_eq!((rays.len(), told.rays_read, told.rays_written), (4000, 4000, 4000));
        let sum = |rays: &[RawRay]| rays.iter().map(|ray| ray.radiant).sum::<f64>();
        assert!((sum(&rays[..1000]) - 6.0).abs() < 1e-5 && (sum(&rays[1000..]) - 2.0).abs() < 1e-5, "{target:?}");
        assert!((told.flux_out.radiant_w.unwrap() - 8.0).abs() < 1e-5);
        let own: Vec<RawRay> = [1, 2]
            .iter()
            .zip([1000, 3000])
            .flat_map(|(seed, rays)| {
                let Input { bytes, .. } = channel("", rays, *seed, Declared::default());
                let mut all = vec![0; bytes.len() as usize];
                bytes.read_at(0, &mut all).unwrap();
                rays_of(&all)
            })
            .collect();
        assert!(
            rays.iter().zip(&own).all(|(ray, own)| ray.origin_mm == own.origin_mm && ray.direction == own.direction)
        );
    }
}

fn table(points: &[(f64, f64)]) -> Declared {
    Declared { spectrum: Table::new(points), ..Declared::default() }
}

/// What each channel's rays say of the spectrum stays with them, or the answer is no.
#[test]
fn spectra_of_channels_stay_with_their_rays_or_are_refused() {
    let blue = table(&[(440.0, 1.0), (460.0, 1.0)]);
    let (red, line) = (table(&[(620.0, 1.0), (640.0, 2.0)]), table(&[(650.0, 1.0)]));
    let two = |a: &Declared, b: &Declared| [channel("a", 100, 1, a.clone()), channel("b", 100, 2, b.clone())];
    let open = |bytes: Vec<u8>| open(Arc::new(bytes), &Declared::default(), &Limits::default()).unwrap();

    let (out, _) = written(&two(&blue, &red), &wanted(Target::Tm25)).unwrap();
    let both = [&blue, &red].map(|declared| declared.spectrum.clone().unwrap()).to_vec();
    assert_eq!(rays_of(&out).iter().map(|ray| ray.table).collect::<Vec<_>>(), [[0; 100], [1; 100]].concat());
    assert_eq!(open(out).facts.spectral, SpectralData::Tables(both));
    // The same spectrum for both is one for all.
    let (out, told) = written(&two(&blue, &blue), &wanted(Target::ZemaxBinary)).unwrap();
    assert_eq!(
        (open(out).facts.ray_count, told.notices.last().unwrap().code.as_ref()),
        (200, "rays.spectrum_replaced")
    );
    assert!(codes(&told).contains(&"convert.spectrum_left_out"));
    for (target, code) in
        [(Target::ZemaxBinary, "zemax.color_per_ray"), (Target::LightToolsBinary, "lighttools.color_per_ray")]
    {
        assert_eq!(written(&two(&blue, &red), &wanted(target)).unwrap_err().code(), code);
    }
    // One wavelength for all rays of a file becomes that of each ray.
    for target in TARGETS {
        let lines = two(&table(&[(450.0, 1.0)]), &line);
        let (out, _) = written(&lines, &wanted(target)).unwrap();
        let found = rays_of(&out).iter().map(|ray| ray.wavelength_nm.round()).collect::<Vec<_>>();
        assert_eq!(found, [[450.0; 100], [650.0; 100]].concat(), "{target:?}");
    }
    // Where one has a spectrum and the other none, nothing is made up; the remedy is taken.
    let mut zemax = converted(sample("flat-chip", 100), Target::ZemaxBinary).unwrap().0;
    zemax[8] = b'x';
    let bare = |declared: Declared| [channel("a", 100, 1, blue.clone()), Input { declared, ..input(zemax.clone()) }];
    let error = written(&bare(Declared::default()), &wanted(Target::Tm25)).unwrap_err();
    assert_eq!(error.code(), "convert.spectra_differ");
    assert!(error.to_string().contains("Declare the spectrum of every channel"), "{error}");
    assert_eq!(written(&bare(red), &wanted(Target::Tm25)).unwrap().1.rays_written, 200);
}

/// By the bits of all their numbers, so that rays can be counted and sorted.
fn bits(ray: &RawRay) -> Vec<u64> {
    ray.origin_mm.iter().chain(&ray.direction).chain(&[ray.radiant]).map(|number| number.to_bits()).collect()
}

/// Sorted rays come out in an order that the inspection calls random, all of them, the same for the same seed.
#[test]
fn a_sorted_file_is_shuffled() {
    let mut rays = rays_of(&sample("flat-chip", 40_000));
    rays.sort_by(|a, b| a.origin_mm[0].total_cmp(&b.origin_mm[0]));
    let header = Header { radiant_w: Some(1.0), flags: W, ..Header::default() };
    let sorted = file(header, Vec::new(), Additional::default(), &rays);
    let order = |bytes: &[u8]| {
        let watch = StageWatch::enter(&NoProgress, Stage::Rays).unwrap();
        crate::inspection::inspect(&input(bytes.to_vec()), &Limits::default(), watch).unwrap().order.unwrap().sorted
    };
    assert!(order(&sorted));
    for target in TARGETS {
        let shuffle = |seed| Wanted { shuffle: Some(seed), ..wanted(target) };
        let (out, told) = written(&[input(sorted.clone())], &shuffle(3)).unwrap();
        assert!(!order(&out), "{target:?}");
        assert_eq!(told.rays_written, 40_000);
        let [mut before, mut after] =
            [rays.clone(), rays_of(&out)].map(|rays| rays.iter().map(bits).collect::<Vec<_>>());
        assert!(before != after);
        before.sort_unstable();
        after.sort_unstable();
        assert!(before == after, "{target:?}: other rays");
        assert!(out == written(&[input(sorted.clone())], &shuffle(3)).unwrap().0);
        assert!(out != written(&[input(sorted.clone())], &shuffle(4)).unwrap().0);
    }
}

/// Exactly so many, any as likely as any other, each file's flux as it was.
#[test]
fn a_part_of_the_rays_has_the_flux_of_all() {
    let inputs = [
        channel("a", 30_000, 1, with_flux(FluxOverride::RadiantW(3.0))),
        channel("b", 20_000, 2, with_flux(FluxOverride::RadiantW(1.0))),
    ];
    let take = |rays, seed, target| Wanted { take: Some(Take { rays, seed }), ..wanted(target) };
    let (all, _) = written(&inputs, &wanted(Target::Tm25)).unwrap();
    let places: std::collections::HashMap<Vec<u64>, usize> =
        rays_of(&all).iter().enumerate().map(|(k, ray)| (bits(ray)[..6].to_vec(), k)).collect();
    assert_eq!(places.len(), 50_000);
    for target in TARGETS {
        let (out, told) = written(&inputs, &take(10_000, 5, target)).unwrap();
        let rays = rays_of(&out);
        assert_eq!((told.rays_read, told.rays_used, told.rays_written, rays.len()), (50_000, 50_000, 10_000, 10_000));
        let at: Vec<usize> = rays.iter().map(|ray| places[&bits(ray)[..6].to_vec()]).collect();
        assert!(at.is_sorted(), "their order stays");
        let of_a = at.iter().filter(|at| **at < 30_000).count();
        // Hypergeometric: mean 6000, standard deviation 43.8.
        assert!((of_a as f64 - 6000.0).abs() < 5.0 * 43.8, "{of_a}");
        // The sum of the places of 10 000 of 50 000: standard deviation of the mean 129.
        let mean = at.iter().sum::<usize>() as f64 / 1e4;
        assert!((mean - 24_999.5).abs() < 5.0 * 129.0, "{mean}");
        let sum = |rays: &[RawRay]| rays.iter().map(|ray| ray.radiant).sum::<f64>();
        assert!((sum(&rays[..of_a]) - 3.0).abs() < 1e-5 && (sum(&rays[of_a..]) - 1.0).abs() < 1e-5);
        assert!(out == written(&inputs, &take(10_000, 5, target)).unwrap().0);
        assert!(out != written(&inputs, &take(10_000, 6, target)).unwrap().0);
    }
    assert!(written(&inputs, &take(50_000, 1, Target::Tm25)).unwrap().0 == all);
    let refused = |rays| written(&inputs, &take(rays, 1, Target::Tm25)).unwrap_err().code();
    assert_eq!([refused(50_001), refused(1)], ["convert.take_too_many", "convert.take_too_few"]);
}

/// A part in random order is the same rays as the part alone.
#[test]
fn a_part_can_be_shuffled() {
    let inputs = [input(sample("four-chips", 40_000))];
    let take = Wanted { take: Some(Take { rays: 9000, seed: 2 }), ..wanted(Target::ZemaxBinary) };
    let [mut part, mut shuffled] = [take, Wanted { shuffle: Some(1), ..take }]
        .map(|wanted| rays_of(&written(&inputs, &wanted).unwrap().0).iter().map(bits).collect::<Vec<_>>());
    assert!(part != shuffled);
    part.sort_unstable();
    shuffled.sort_unstable();
    assert!(part == shuffled);
}
