//! Sources of several files, and what a user declares of each: fluxes, shares, spectra, units. Expected values are sums of
//! closed forms, or the vendor's data sheet.
#![expect(
    clippy::unwrap_used,
    clippy::panic,
    reason = "clippy.toml allows it in #[test] functions only, and these are their tools"
)]

use crate::rays::{LUMENS, WATTS, close, file, good, pass, read_all, sums};
use crate::real_files::real;
use pipeline::formats::bytes::digest;
use pipeline::formats::record::RawRay;
use pipeline::formats::tm25::header::{Flags, SpectralId};
use pipeline::known_sources::{by_name, write_tm25};
use pipeline::source::Source;
use pipeline::vocabulary::spectrum::{Bands, Table};
use pipeline::vocabulary::watch::StageWatch;
use pipeline::{
    Claims, Column, Declared, Error, FluxOverride, Input, LengthUnit, Limits, NoProgress, Options, Place, Quantity,
    Stage, Total, header, judge, run, spectrum,
};
use std::sync::Arc;

/// 683 lm/W times V(λ) at 555 nm, which is 1.
const LM_PER_W_555: f64 = 683.0;

fn channel(bytes: &[u8], declared: Declared) -> Input {
    Input {
        name: "file".into(),
        sha256: digest(&bytes.to_vec()).unwrap(),
        bytes: Arc::new(bytes.to_vec()),
        declared,
        notices: Vec::new(),
    }
}

fn source(inputs: &[Input], total: Option<Total>) -> Result<Source, Error> {
    let options = Options::default().rays;
    let options = pipeline::options::RaysOptions { total, ..options };
    Source::read(inputs, &options, &Limits::default(), StageWatch::enter(&NoProgress, Stage::Rays)?)
}

fn fault(result: Result<Source, Error>) -> (&'static str, Option<Place>) {
    match result.err() {
        Some(Error::Refused(fault) | Error::Unusable(fault) | Error::Malformed(fault)) => (fault.code, fault.at),
        other => panic!("{other:?}"),
    }
}

fn flux(flux: FluxOverride) -> Declared {
    Declared { flux: Some(flux), ..Declared::default() }
}

fn line(nm: f64) -> Option<Table> {
    Table::new(&[(nm, 1.0)])
}

/// One ray of 2 W, or of 2 lm, without a spectrum; the ray starts at x = 1.
fn watts() -> Vec<u8> {
    file(WATTS, SpectralId::None, vec![], &[RawRay { origin_mm: [1.0, 0.0, 0.0], ..good() }])
}

fn lumens() -> Vec<u8> {
    file(LUMENS, SpectralId::None, vec![], &[good()])
}

/// W and lm, of the totals and of the rays.
#[track_caller]
fn gives(source: &Source, watt: Option<f64>, lumen: Option<f64>) {
    let near = |found: Option<f64>, expected: Option<f64>| match (found, expected) {
        (Some(found), Some(expected)) => close(found, expected, 1e-9),
        (found, expected) => found == expected,
    };
    assert!(near(source.flux.radiant_w, watt) && near(source.flux.luminous_lm, lumen), "{:?}", source.flux);
    let sums = pass(source);
    assert!(close(sums[1], watt.unwrap_or(0.0), 1e-9) && close(sums[2], lumen.unwrap_or(0.0), 1e-9), "{sums:?}");
}

#[test]
fn a_flux_fixes_its_quantity_and_the_other_scales_along() {
    let table = || Declared { spectrum: line(555.0), ..Declared::default() };
    let of = |bytes: &[u8], declared: Declared| source(&[channel(bytes, declared)], None).unwrap();
    gives(&of(&watts(), flux(FluxOverride::RadiantW(5.0))), Some(5.0), None);
    gives(&of(&lumens(), flux(FluxOverride::LuminousLm(5.0))), None, Some(5.0));
    for bytes in [watts(), lumens()] {
        let fixed = |flux| of(&bytes, Declared { flux: Some(flux), ..table() });
        gives(&fixed(FluxOverride::RadiantW(5.0)), Some(5.0), Some(5.0 * LM_PER_W_555));
        gives(&fixed(FluxOverride::LuminousLm(5.0)), Some(5.0 / LM_PER_W_555), Some(5.0));
    }
    // Both stored: their ratio stays, here 1.
    let both = file(Flags { radiant: true, ..LUMENS }, SpectralId::None, vec![], &[good()]);
    gives(&of(&both, flux(FluxOverride::LuminousLm(7.0))), Some(7.0), Some(7.0));
    // Per-ray wavelengths: 1 W at 555 nm and 3 W at 1000 nm, which nobody sees, are 683 lm; 341.5 lm are half of each.
    let rays = [(555.0, 1.0), (1000.0, 3.0)];
    let rays = rays.map(|(wavelength_nm, radiant)| RawRay { wavelength_nm, radiant, ..good() });
    let colored = file(Flags { wavelength: true, ..WATTS }, SpectralId::PerRay, vec![], &rays);
    gives(&of(&colored, flux(FluxOverride::LuminousLm(341.5))), Some(2.0), Some(341.5));
    // Nothing to scale: 5 lm of infrared.
    let infrared = Declared { spectrum: line(940.0), ..flux(FluxOverride::LuminousLm(5.0)) };
    let dark = source(&[channel(&watts(), table()), channel(&colored, infrared)], None);
    assert_eq!(fault(dark), ("rays.flux_dark", Some(Place::Channel(1, "flux"))));
}

#[test]
fn a_flux_in_the_other_quantity_makes_values_relative_and_guesses_nothing() {
    let weights = source(&[channel(&lumens(), flux(FluxOverride::RadiantW(5.0)))], None).unwrap();
    gives(&weights, Some(5.0), None);
    assert_eq!(weights.notices.count_of("rays.relative_weights"), 1);
    gives(&source(&[channel(&watts(), flux(FluxOverride::LuminousLm(5.0)))], None).unwrap(), None, Some(5.0));
    // It is what makes lm beside W one source.
    let inputs = [channel(&watts(), Declared::default()), channel(&lumens(), flux(FluxOverride::RadiantW(5.0)))];
    gives(&source(&inputs, None).unwrap(), Some(7.0), None);
}

#[test]
fn shares_of_a_total_are_those_of_all_channels() {
    let spectra = |share: FluxOverride, nm: f64| Declared { spectrum: line(nm), ..flux(share) };
    let two = |a: Declared, b: Declared| [channel(&watts(), a), channel(&lumens(), b)];
    let radiant = |a: f64, b: f64| {
        two(spectra(FluxOverride::RadiantShare(a), 555.0), spectra(FluxOverride::RadiantShare(b), 555.0))
    };
    let split = source(&radiant(0.25, 0.75), Some(Total::RadiantW(8.0))).unwrap();
    gives(&split, Some(8.0), Some(8.0 * LM_PER_W_555));
    assert_eq!(split.channels.iter().map(|c| c.flux.radiant_w.unwrap()).collect::<Vec<_>>(), [2.0, 6.0]);
    let luminous = |a: f64, b: f64| two(flux(FluxOverride::LuminousShare(a)), flux(FluxOverride::LuminousShare(b)));
    let split = source(&luminous(0.1, 0.9), Some(Total::LuminousLm(30.0))).unwrap();
    gives(&split, None, Some(30.0));
    assert_eq!(split.channels[1].fixed, Some(Total::LuminousLm(27.0)));

    let watt = Some(Total::RadiantW(1.0));
    let at = |k: usize| Some(Place::Channel(k, "flux"));
    let cases = [
        (source(&radiant(0.25, 0.75), None), "rays.share_without_total", at(0)),
        (source(&luminous(0.1, 0.9), watt), "rays.share_quantity", at(0)),
        (source(&radiant(0.25, 0.75 + 2e-6), watt), "rays.share_sum", Some(Place::Total)),
        (source(&radiant(0.25, 0.25), watt), "rays.share_sum", Some(Place::Total)),
        (source(&two(flux(FluxOverride::RadiantShare(1.0)), Declared::default()), watt), "rays.share_missing", at(1)),
        (
            source(&two(flux(FluxOverride::RadiantW(1.0)), flux(FluxOverride::RadiantShare(1.0))), watt),
            "rays.share_missing",
            at(0),
        ),
        (source(&two(Declared::default(), Declared::default()), watt), "rays.total_unused", Some(Place::Total)),
    ];
    for (result, code, place) in cases {
        assert_eq!(fault(result), (code, place));
    }
    assert!(source(&radiant(0.25, 0.75 + 5e-7), watt).is_ok(), "within 1e-6");
}

#[test]
fn numbers_that_cannot_be_fluxes_are_refused() {
    for wrong in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        for declared in
            [FluxOverride::RadiantW(wrong), FluxOverride::LuminousLm(wrong), FluxOverride::RadiantShare(wrong)]
        {
            let inputs = [channel(&watts(), Declared::default()), channel(&lumens(), flux(declared))];
            let expected = ("rays.flux_impossible", Some(Place::Channel(1, "flux")));
            assert_eq!(fault(source(&inputs, Some(Total::RadiantW(1.0)))), expected, "{declared:?}");
        }
        let inputs = [channel(&watts(), flux(FluxOverride::RadiantShare(1.0)))];
        assert_eq!(fault(source(&inputs, Some(Total::RadiantW(wrong)))), ("rays.flux_impossible", Some(Place::Total)));
    }
    let above = [channel(&watts(), flux(FluxOverride::RadiantShare(1.1)))];
    assert_eq!(fault(source(&above, Some(Total::RadiantW(1.0)))).0, "rays.flux_impossible");
}

#[test]
fn what_is_declared_goes_before_the_files_own_word() {
    let of = |bytes: &[u8], declared: Declared| source(&[channel(bytes, declared)], None).unwrap();
    // TM-25 is in mm; declared to be in inches, x = 1 is 25.4 mm.
    let inches = of(&watts(), Declared { length_unit: Some(LengthUnit::Inch), ..Declared::default() });
    assert!(close(inches.survey.bounds_mm.max.x, 25.4, 1e-12));
    assert_eq!(inches.notices.count_of("rays.unit_replaced"), 1);
    let luminous = Declared { quantity: Some(Quantity::Luminous), ..Declared::default() };
    let said = of(&watts(), luminous.clone());
    gives(&said, None, Some(2.0));
    assert_eq!(said.notices.count_of("rays.quantity_replaced"), 1);
    let lumens = Some(FluxOverride::LuminousLm(2.0));
    let colored = Declared { spectrum: line(555.0), flux: lumens, ..luminous };
    gives(&of(&watts(), colored), Some(2.0 / LM_PER_W_555), Some(2.0));
    // The lm that the header has beside its W hold, and the declared table goes on from them.
    let mut chip = Vec::new();
    let known = by_name("flat-chip").unwrap();
    write_tm25(&known, 100, 1, &mut chip).unwrap();
    let lm = Declared { quantity: Some(Quantity::Luminous), spectrum: line(555.0), ..Declared::default() };
    let chip_in_lm = of(&chip, lm);
    assert!(close(chip_in_lm.flux.luminous_lm.unwrap(), known.luminous_lm(), 1e-6), "{:?}", chip_in_lm.flux);
    assert!(close(chip_in_lm.flux.radiant_w.unwrap(), known.luminous_lm() / LM_PER_W_555, 1e-6));
    assert_eq!(chip_in_lm.notices.count_of("rays.spectrum_replaced"), 1);
    // And the table's lm/W holds, not the header's.
    let chip_at_555 = of(&chip, Declared { spectrum: line(555.0), ..Declared::default() });
    assert!(close(chip_at_555.flux.luminous_lm.unwrap(), LM_PER_W_555, 1e-6), "{:?}", chip_at_555.flux);

    let columns = Declared { columns: Some(vec![Column::X]), ..Declared::default() };
    let expected = ("rays.columns_not_text", Some(Place::Channel(0, "columns")));
    assert_eq!(fault(source(&[channel(&watts(), columns)], None)), expected);
    let both = file(Flags { radiant: true, ..LUMENS }, SpectralId::None, vec![], &[good()]);
    let quantity = Declared { quantity: Some(Quantity::Radiant), ..Declared::default() };
    assert_eq!(fault(source(&[channel(&both, quantity)], None)).0, "rays.quantity_both");
}

/// A word alone makes no lumens of watts: the header's own total in the declared quantity holds, what a spectrum tells is not declared, and
/// only a flux in the declared quantity gives the numbers another meaning.
#[test]
fn a_declared_quantity_is_the_files_own_where_it_knows_it() {
    let of = |bytes: &[u8], declared: Declared| source(&[channel(bytes, declared)], None);
    let said = |quantity: Quantity| Declared { quantity: Some(quantity), ..Declared::default() };
    let with_totals = |mut bytes: Vec<u8>| {
        bytes[12..16].copy_from_slice(&763.0_f32.to_le_bytes());
        bytes[16..20].copy_from_slice(&2.4_f32.to_le_bytes());
        bytes
    };
    let [luminous, radiant] = [Quantity::Luminous, Quantity::Radiant].map(said);
    gives(&of(&with_totals(watts()), luminous.clone()).unwrap(), None, Some(763.0));
    gives(&of(&with_totals(lumens()), radiant).unwrap(), Some(f64::from(2.4_f32)), None);
    let known = |name: &str| {
        let mut bytes = Vec::new();
        write_tm25(&by_name(name).unwrap(), 1000, 1, &mut bytes).unwrap();
        bytes
    };
    // One spectrum for all: W and lm are in proportion, and the word changes nothing.
    let [plain, word] =
        [Declared::default(), luminous.clone()].map(|declared| of(&known("flat-chip"), declared).unwrap());
    for (own, declared) in
        [(plain.flux.radiant_w, word.flux.radiant_w), (plain.flux.luminous_lm, word.flux.luminous_lm)]
    {
        assert!(close(declared.unwrap(), own.unwrap(), 1e-6), "{:?} {:?}", plain.flux, word.flux);
    }
    // A wavelength for each ray: lm are known, and those of another light only with their total.
    let place = Some(Place::Channel(0, "quantity"));
    let chips = known("four-chips");
    assert_eq!(fault(of(&chips, luminous.clone())), ("rays.quantity_known", place.clone()));
    let table = Declared { spectrum: line(555.0), ..luminous.clone() };
    assert_eq!(fault(of(&watts(), table)), ("rays.quantity_known", place));
    let meant = Declared { flux: Some(FluxOverride::LuminousLm(2.4)), ..luminous };
    let meant = of(&chips, meant).unwrap();
    assert!(close(meant.flux.luminous_lm.unwrap(), 2.4, 1e-9), "{:?}", meant.flux);
    assert_eq!(meant.notices.count_of("rays.quantity_replaced"), 1);
}

#[test]
fn watts_and_lumens_are_one_source_where_a_spectrum_allows_it() {
    let plain = |bytes: &[u8]| channel(bytes, Declared::default());
    let place = Some(Place::Channel(1, "spectrum"));
    assert_eq!(fault(source(&[plain(&watts()), plain(&lumens())], None)), ("rays.no_common_quantity", place));
    let colored = channel(&lumens(), Declared { spectrum: line(555.0), ..Declared::default() });
    gives(&source(&[plain(&watts()), colored], None).unwrap(), Some(2.0 + 2.0 / LM_PER_W_555), None);
    let colored = channel(&watts(), Declared { spectrum: line(555.0), ..Declared::default() });
    gives(&source(&[colored, plain(&lumens())], None).unwrap(), None, Some(2.0 * LM_PER_W_555 + 2.0));
    // The same rays twice are a mistake, unless each naming has its own flux.
    let (once, twice) = (plain(&watts()), plain(&watts()));
    assert_eq!(fault(source(&[once, twice], None)), ("rays.twice", Some(Place::Channel(0, "flux"))));
    let named = |watt: f64| channel(&watts(), flux(FluxOverride::RadiantW(watt)));
    gives(&source(&[named(1.0), named(2.5)], None).unwrap(), Some(3.5), None);
}

#[test]
fn files_of_different_kinds_become_one_source() {
    // A table beside lumens without one: lumens are common, a spectrum is not.
    let table = file(WATTS, SpectralId::OneTable, vec![vec![(555.0, 1.0)]], &[good()]);
    let source = read_all(vec![table.clone(), lumens()]).unwrap();
    assert_eq!(source.flux.radiant_w, None);
    assert!(close(source.flux.luminous_lm.unwrap(), 1366.0 + 2.0, 1e-9));
    assert_eq!(sums(&source).1, 0.0);
    assert_eq!((source.spectral.column_count(), source.notices.count_of("rays.no_common_spectrum")), (0, 1));
    // A table beside wavelengths: one basis, bands add up.
    let red = RawRay { wavelength_nm: 655.0, radiant: 3.0, ..good() };
    let per_ray = file(Flags { wavelength: true, ..WATTS }, SpectralId::PerRay, vec![], &[red]);
    let source = read_all(vec![table, per_ray]).unwrap();
    let density = source.spectral.bands_w_per_nm(&pass(&source)[3..]);
    let band = |nm: f64| density[source.spectral.bands.band(nm).unwrap()] * 10.0;
    assert!(close(band(555.0), 2.0, 1e-12) && close(band(655.0), 3.0, 1e-12) && band(605.0) == 0.0);
    // A pass shows the rays of all files, in the order of the files.
    let watch = StageWatch::enter(&NoProgress, Stage::Flux).unwrap();
    let watts =
        source.fold(watch, vec![], |rays| Ok(rays.iter().map(|r| r.radiant_w).collect::<Vec<_>>()), Vec::extend);
    assert_eq!(watts.unwrap(), [2.0, 3.0]);
}

/// Wavelengths per ray, one table, a table per ray and a declared table in one source: the spectrum is their sum.
#[test]
fn every_kind_of_spectrum_adds_up_in_one_source() {
    let at = |wavelength_nm: f64, radiant: f64, table: u32| RawRay { wavelength_nm, radiant, table, ..good() };
    let per_ray = file(Flags { wavelength: true, ..WATTS }, SpectralId::PerRay, vec![], &[at(455.0, 3.0, 0)]);
    let one = file(WATTS, SpectralId::OneTable, vec![vec![(505.0, 1.0)]], &[at(0.0, 5.0, 0)]);
    let lines = vec![vec![(555.0, 1.0)], vec![(605.0, 1.0)]];
    let indexed =
        file(Flags { index: true, ..WATTS }, SpectralId::IndexPerRay, lines, &[at(0.0, 7.0, 0), at(0.0, 11.0, 1)]);
    let bare = channel(&watts(), Declared { spectrum: line(655.0), ..Declared::default() });
    let plain = |bytes: &[u8]| channel(bytes, Declared::default());
    let source = source(&[plain(&per_ray), plain(&one), plain(&indexed), bare], None).unwrap();
    let density = source.spectral.bands_w_per_nm(&pass(&source)[3..]);
    let bands = &source.spectral.bands;
    for (nm, watt) in [(455.0, 3.0), (505.0, 5.0), (555.0, 7.0), (605.0, 11.0), (655.0, 2.0), (405.0, 0.0)] {
        assert!((density[bands.band(nm).unwrap()] * 10.0 - watt).abs() < 1e-12, "{nm} nm: {density:?}");
    }
}

/// A chip written in W with a wavelength per ray, and one written in lm with a table: the model has the sum of their fluxes and of
/// their spectra, through the whole pipeline and into its report.
#[test]
fn two_channels_in_different_quantities_sum_in_the_model() {
    const RAYS: u64 = 20_000;
    let blue_chip = by_name("flat-chip").unwrap();
    let mut blue = Vec::new();
    write_tm25(&blue_chip, RAYS, 3, &mut blue).unwrap();
    // The same chip 2 mm to the side, in lm, with a triangular table round 600 nm.
    let mut rays = Vec::new();
    blue_chip.rays(5, RAYS, 0, RAYS as usize, &mut rays);
    let triangle = [(580.0, 0.0), (600.0, 1.0), (620.0, 0.0)];
    let table = Table::new(&triangle).unwrap();
    for ray in &mut rays {
        ray.luminous = 100.0 / RAYS as f64;
        ray.radiant = 0.0;
        ray.origin_mm[0] += 2.0;
    }
    let points = triangle.map(|(nm, weight)| (nm as f32, weight as f32)).to_vec();
    let amber = file(LUMENS, SpectralId::OneTable, vec![points], &rays);
    let named = |name: &str| Declared { name: Some(name.into()), ..Declared::default() };
    let mut options = Options::default();
    options.hull.resolution = Some(8);
    let inputs = [channel(&blue, named("blue")), channel(&amber, named("amber"))];
    let outcome = run(&inputs, &options, &Limits::default(), &NoProgress).unwrap();
    let model = &outcome.model;
    let amber_w = 100.0 / table.lm_per_w();
    assert!(close(model.flux.radiant_w.unwrap(), blue_chip.radiant_w() + amber_w, 1e-5), "{:?}", model.flux);
    assert!(close(model.flux.luminous_lm.unwrap(), blue_chip.luminous_lm() + 100.0, 1e-5), "{:?}", model.flux);
    let bands: &Bands = &model.spectral.bands;
    let mut watt = vec![0.0; bands.len()];
    for vertex in 0..model.hull.vertices_mm.len() {
        let spectrum = model.vertex_spectrum_w_per_nm(vertex);
        watt.iter_mut().zip(spectrum).zip(bands.widths_nm()).for_each(|((sum, value), width)| *sum += value * width);
    }
    let amber_bands = table.shares(bands).into_iter().map(|share| share * amber_w);
    for (band, (found, amber)) in watt.iter().zip(amber_bands).enumerate() {
        let expected = blue_chip.bands_w(bands)[band] + amber;
        assert!((found - expected).abs() < 1e-4 * model.flux.radiant_w.unwrap(), "band {band}: {found} {expected}");
    }
    let report = outcome.artifacts.iter().find(|artifact| artifact.name == "report.json").unwrap();
    let report: serde_json::Value = serde_json::from_slice(&report.bytes).unwrap();
    assert_eq!(report["inputs"][0]["declared"]["spectrum_sha256"], serde_json::Value::Null);
    let told = &report["inputs"][1];
    assert_eq!((told["channel"].as_str(), told["spectrum"]["source"].as_str()), (Some("amber"), Some("file")));
    assert!(close(told["flux"]["radiant_W"].as_f64().unwrap(), amber_w, 1e-5));
    assert!(close(told["share"].as_f64().unwrap(), amber_w / (blue_chip.radiant_w() + amber_w), 1e-5));
}

/// What a stored header leads to is what the file itself leads to.
#[test]
fn headers_are_judged_as_their_files_are() {
    let table = file(LUMENS, SpectralId::OneTable, vec![vec![(555.0, 1.0)]], &[good()]);
    let tristimulus = file(Flags { tristimulus: true, ..LUMENS }, SpectralId::None, vec![], &[good()]);
    let files = [watts(), lumens(), table, tristimulus];
    let declarations = [
        Declared::default(),
        Declared { spectrum: line(555.0), ..Declared::default() },
        Declared { quantity: Some(Quantity::Luminous), ..Declared::default() },
        flux(FluxOverride::RadiantW(1.0)),
        flux(FluxOverride::LuminousShare(0.5)),
        flux(FluxOverride::RadiantShare(0.0)),
        Declared { columns: Some(vec![Column::X]), ..Declared::default() },
    ];
    let (mut good, mut bad) = (0, 0);
    for (a, b) in (0..files.len() * declarations.len()).flat_map(|a| (0..files.len()).map(move |b| (a, b))) {
        let inputs = [
            channel(&files[a / declarations.len()], declarations[a % declarations.len()].clone()),
            channel(&files[b], Declared::default()),
        ];
        let stored: Vec<Claims> = inputs
            .iter()
            .map(|input| header(&Input { declared: Declared::default(), ..input.clone() }, &Limits::default()).unwrap())
            .map(|header| serde_json::from_str(&serde_json::to_string(&header).unwrap()).unwrap())
            .collect();
        let claims: Vec<_> =
            inputs.iter().zip(&stored).map(|(i, c)| (i.name.as_str(), i.sha256.as_str(), c, &i.declared)).collect();
        let judged = judge(&claims, None).map(|_| ()).map_err(|error| error.to_string());
        let read = source(&inputs, None).map(|_| ()).map_err(|error| error.to_string());
        assert_eq!(judged, read, "{a} {b}");
        if judged.is_ok() { good += 1 } else { bad += 1 }
    }
    assert!(good > 20 && bad > 20, "{good} {bad}");
}

// ---- Real files ----

/// The data sheet's split of the white chip into its yellow and blue file, page 7: 0.931 / 0.069 in lm, 0.636 / 0.364 in W. With the
/// spectra of the two files each split implies the other, within the rounding of three digits.
#[test]
fn osram_white_splits_in_lumens_and_in_watts_agree() {
    let Some(yellow) = real("mu_LERTDUW_S2WP_binBQ_white-yellow_20110706_spectrum.txt") else { return };
    let Some(blue) = real("mu_LERTDUW_S2WP_binBQ_white-blue_20110706_spectrum.txt") else { return };
    let (yellow, blue) = (spectrum(&yellow).unwrap(), spectrum(&blue).unwrap());
    assert_eq!((yellow.table.range_nm(), blue.table.range_nm()), ((510.0, 810.0), (393.0, 510.0)));
    let declared = |table: &Table, share: f64| Declared {
        spectrum: Some(table.clone()),
        ..flux(FluxOverride::LuminousShare(share))
    };
    let inputs = [channel(&watts(), declared(&yellow.table, 0.931)), channel(&lumens(), declared(&blue.table, 0.069))];
    let white = source(&inputs, Some(Total::LuminousLm(100.0))).unwrap();
    let share = white.channels[0].flux.radiant_w.unwrap() / white.flux.radiant_w.unwrap();
    println!("lm 0.931 / 0.069 gives W {share:.4} / {:.4}; sheet 0.636 / 0.364", 1.0 - share);
    // Half a unit of the third digit: of 0.069 lm it is 0.7 % of the blue W, 0.0017 of the share; and 0.0005 of 0.636 itself.
    assert!((share - 0.636).abs() < 0.0022, "{share}");
}

/// LightTools' form of a white LED, 166 points after five lines of header.
#[test]
fn lighttools_spectrum_is_read() {
    let Some(bytes) = real("mu_LEDWhite.txt") else { return };
    let white = spectrum(&bytes).unwrap();
    assert_eq!((white.format.name(), white.table.points().len()), ("LightTools .sre", 166));
    assert_eq!((white.table.range_nm(), white.notices.iter().count()), ((393.0, 810.0), 0));
}

/// 337 lm of the header with the file's own table declared give the sheet's 0.694 W within 0.5 %.
#[test]
fn osram_green_gives_its_watts_by_its_own_table() {
    let Some(bytes) = real("mu_rayfile_LERTDUW_S2WP_green_100k_20161013_IES_TM25.TM25RAY") else { return };
    let own = source(&[channel(&bytes, Declared::default())], None).unwrap();
    let table = own.channels[0].facts().spectral.tables()[0].clone();
    let declared = Declared { spectrum: Some(table), ..Declared::default() };
    let green = source(&[channel(&bytes, declared)], None).unwrap();
    let watt = green.flux.radiant_w.unwrap();
    println!("own header {:?}; by its table declared {watt:.5} W", own.flux);
    assert!(close(green.flux.luminous_lm.unwrap(), 337.0, 1e-9));
    assert!(close(watt, 0.694, 0.005), "{watt}");
}
