//! Files laid out here against what becomes of them; expected numbers are the files' own.

use super::labels::text;
use super::*;
use crate::formats::bytes::digest;
use crate::formats::tm25::Preamble;
use crate::formats::tm25::additional::Additional;
use crate::formats::tm25::header::{Flags, Header, SpectralId};
use crate::formats::tm25::spectra::Spectra;
use crate::known_sources::{by_name, write_tm25};
use crate::rays::declared::open;
use crate::vocabulary::declaration::Declared;
use crate::vocabulary::watch::{NoProgress, Stage};
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
    let mut out = Vec::new();
    let watch = StageWatch::enter(&NoProgress, Stage::Rays)?;
    match convert(&input(bytes), target, &Limits::default(), &mut out, watch) {
        Ok(told) => Ok((out, told)),
        Err(Failed::Read(error)) => Err(error),
        Err(Failed::Write(error)) => panic!("{error}"),
    }
}

fn sample(name: &str, rays: u64) -> Vec<u8> {
    let mut bytes = Vec::new();
    write_tm25(&by_name(name).unwrap(), rays, 5, &mut bytes).unwrap();
    bytes
}

const W: Flags =
    Flags { radiant: true, wavelength: false, luminous: false, stokes: false, tristimulus: false, index: false };

/// A TM-25 file of these rays.
fn file(header: Header, tables: Vec<Vec<(f32, f32)>>, additional: Additional, rays: &[RawRay]) -> Vec<u8> {
    let preamble = Preamble::new(Header { ray_count: rays.len() as u64, ..header }, Spectra::new(tables), additional);
    let mut bytes = Vec::new();
    let mut writer = Writer::<crate::formats::tm25::writer::Rows>::start(&mut bytes, &preamble).unwrap();
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
    let set = open(Arc::new(bytes.to_vec()), &Declared::default(), &Limits::default()).unwrap();
    let mut rays = Vec::new();
    set.records.read(0, set.facts.ray_count as usize, &mut rays).unwrap();
    rays
}

#[test]
fn a_file_of_ours_to_its_own_format_is_the_same_bytes() {
    let chip = sample("flat-chip", 40_000);
    let (again, told) = converted(chip.clone(), Target::Tm25).unwrap();
    assert!(again == chip, "not the same bytes");
    assert_eq!((told.format, told.rays_read, told.rays_written), (Format::Tm25, 40_000, 40_000));
    // Where the rays have wavelengths, the header's range becomes that of the rays; then all stays.
    for target in [Target::Tm25, Target::ZemaxBinary] {
        let (once, _) = converted(sample("four-chips", 20_000), target).unwrap();
        let (twice, told) = converted(once.clone(), target).unwrap();
        assert!(twice == once, "{target:?}");
        assert_eq!(told.notices, []);
    }
}

#[test]
fn rays_go_to_zemax_and_back_to_the_last_digit() {
    let chip = sample("flat-chip", 20_000);
    let (zemax, told) = converted(chip.clone(), Target::ZemaxBinary).unwrap();
    let codes: Vec<_> = told.notices.iter().map(|notice| notice.code.as_ref()).collect();
    assert_eq!(codes, ["convert.spectrum_left_out"]);
    assert_eq!(zemax.len(), 208 + 28 * 20_000);
    let (back, told) = converted(zemax, Target::Tm25).unwrap();
    assert_eq!(told.format, Format::ZemaxBinary);
    assert!(rays_of(&back) == rays_of(&chip));
    assert!((told.flux_out.radiant_w.unwrap() - 1.0).abs() < 1e-6 && told.flux_out.luminous_lm.is_none());
}

#[test]
fn relative_rays_are_scaled_to_the_headers_total_and_useless_ones_left_out() {
    let header = Header { radiant_w: Some(5.0), flags: W, ..Header::default() };
    let mut rays = vec![up(1.0); 200];
    rays[7].radiant = 0.0;
    rays[9].direction = [2.0, 0.0, 0.0];
    let bytes = file(header, Vec::new(), Additional::default(), &rays);
    for target in [Target::Tm25, Target::ZemaxBinary] {
        let (out, told) = converted(bytes.clone(), target).unwrap();
        let rays = rays_of(&out);
        assert_eq!((told.rays_read, told.rays_written, rays.len()), (200, 198, 198));
        assert_eq!(f64::from((5.0 / 198.0) as f32), rays[0].radiant);
        assert!((told.flux_out.radiant_w.unwrap() - 5.0).abs() < 1e-6);
        assert_eq!(told.flux_in.radiant_w, Some(5.0));
        let codes: Vec<_> = told.notices.iter().map(|notice| notice.code.as_ref()).collect();
        assert_eq!(codes, ["rays.direction_length", "rays.flux_zero", "rays.total_ratio"]);
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
    for bytes in
        [file(index, tables, Additional::default(), &rays), file(xyz, Vec::new(), Additional::default(), &rays)]
    {
        assert_eq!(converted(bytes, Target::ZemaxBinary).unwrap_err().code(), "zemax.color_per_ray");
    }
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

/// A stream that is full after so many bytes.
struct Full(usize);

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
        let done = convert(&input, Target::Tm25, &Limits::default(), &mut Full(room), watch);
        assert!(matches!(done, Err(Failed::Write(error)) if error.kind() == io::ErrorKind::StorageFull), "{room}");
    }
}
