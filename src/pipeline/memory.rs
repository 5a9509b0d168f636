//! What a run needs of the machine's memory, before it begins. Rays pass by in chunks, so their number matters only for the
//! resolution that is chosen by it; what is kept is the lattice, the surface and its spectra, the goniograms and the files.
//!
//! Nothing is known of the source's form yet: it is taken for a body that fills its box, a sphere or a cube. What was measured of
//! domes and cylinders is a fifth to nearly all of what is said here, of flat chips down to an eighth.

use crate::formats::record::SpectralData;
use crate::options::{Emission, GoniogramOptions, Options, Spectra};
use crate::rays::bands;
use crate::rays::bands::Reach;
use crate::source::channels::Claims;
use crate::vocabulary::declaration::Declared;

const MIB: f64 = (1 << 20) as f64;
/// Program, readers and small things; and the chunks of rays of each thread.
const PROCESS: f64 = 8.0 * MIB;
const THREAD: f64 = 3.5 * MIB;
/// A ray of the sample by which surfaces are compared, and the models of two that are compared; and most rays of the sample.
const SAMPLED_RAY: f64 = 700.0;
const MOST_SAMPLED: f64 = 70_000.0;
/// A cell of the lattice: its count, its slot, whether it is solid, and the coarser lattices.
const LATTICE_CELL: f64 = 12.0;
/// A vertex while the hull is made; and for each thread, what it saw of the light there.
const HULL_VERTEX: f64 = 400.0;
const HULL_VERTEX_THREAD: f64 = 72.0;
/// What threads add up of their own, of each table that is below this size for all of them together: 8 bytes a number, three and the columns
/// for each vertex, triangle, cell and node. (What is larger is shared.)
const MOST_OWN_NUMBERS: f64 = 4_194_304.0;
const OWN_NUMBER: f64 = 8.0;
/// A vertex later: mesh, fluxes, its neighbours in smoothing, and its numbers in the files.
const VERTEX: f64 = 1750.0;
/// A band of a vertex in the files; where rays have wavelengths also as a sum, twice for a while.
const VERTEX_BAND: f64 = 8.0;
const VERTEX_COLUMN: f64 = 10.0;
/// A spectral number as text, and how many are written so unless asked.
const NUMBER: f64 = 14.0;
const MOST_INLINE: f64 = 5e5;
/// A cell of a zone's goniogram: sums, intensities, text.
const CELL: f64 = 70.0;
/// A band of a zone's spectral goniogram: 156 nodes, as numbers and as text; and a column of its 134 cells.
const ZONE_BAND: f64 = 4300.0;
const ZONE_COLUMN: f64 = 3300.0;
/// A band of a zone's flux alone, where its spectral goniogram is left out.
const ONE_SPECTRUM_BAND: f64 = 100.0;
/// A cell of directions while it is smoothed: its neighbourhoods.
const SMOOTHED_CELL: f64 = 900.0;

/// Vertices of a body's surface, per square of the resolution: a sphere has 4.7; a cube 6, whose flat sides are cheaper.
const VERTICES: f64 = 5.0;
/// With fewer rays per square of an asked resolution, the surface has holes, and twice as many vertices.
const DENSE: f64 = 4.0;
/// The finest and the coarsest resolution that are chosen by the rays; and at least so many rays for each vertex then.
const CHOSEN: (f64, f64) = (96.0, 8.0);
const RAYS_PER_VERTEX: f64 = 12.0;
/// Cells of all zones together and their spectral columns unless zones are asked for; the grid of the latter.
const CELLS: f64 = 350_000.0;
const COLUMNS: f64 = 2e6;
const GAMMA_DEG: f64 = 2.5;
const C_DEG: f64 = 5.0;
/// Zones unless asked for, the rays that one needs, and cells of its spectral grid.
const ZONES: f64 = 256.0;
const RAYS_PER_ZONE: f64 = 200.0;
const ZONE_CELLS: f64 = 134.0;
/// Nodes of a volume, most of them and of their spectral numbers, and what one needs: its neighbours in smoothing, and each band and column.
const RAYS_PER_NODE: f64 = 20.0;
const NODES: (f64, f64) = (2_000.0, 32_000.0);
const NODE_NUMBERS: f64 = 1.3e6;
const NODE: f64 = 1500.0;
const NODE_BAND: f64 = 8.0;
const NODE_COLUMN: f64 = 16.0;
/// Columns of a file with spectral tables: one for each table.
const TABLES: f64 = 16.0;

/// Most memory that a run is expected to need, bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MemoryNeed {
    /// On as many threads as were asked for, or fewer.
    pub bytes: u64,
    /// At most so much more for each further thread.
    pub thread_bytes: u64,
}

/// What [`crate::run`] is expected to need.
pub fn estimate(files: &[(&Claims, &Declared)], options: &Options, threads: usize) -> MemoryNeed {
    let rays: f64 = files.iter().map(|(claims, _)| claims.ray_count as f64).sum();
    let spectrum = Spectrum::of(files, options);
    let (cells, vertices) = surface(rays, options.hull.resolution.map(f64::from));
    let threads = threads.max(1) as f64;
    let landing = vertices * HULL_VERTEX + tables(rays, vertices, &spectrum, options, threads);
    let hull = LATTICE_CELL * cells + vertices * (HULL_VERTEX + HULL_VERTEX_THREAD * threads);
    let rest = vertices * VERTEX
        + spectrum.of_vertices(vertices, options.artifacts.spectra.unwrap_or_default())
        + volume(rays, &spectrum, options)
        + directions(rays, &spectrum, options);
    MemoryNeed {
        bytes: (PROCESS + THREAD * threads + SAMPLED_RAY * rays.min(MOST_SAMPLED) + hull.max(landing).max(rest)) as u64,
        thread_bytes: (THREAD
            + f64::max(vertices * HULL_VERTEX_THREAD, tables(rays, vertices, &spectrum, options, 1.0)))
        .ceil() as u64,
    }
}

/// Cells of the lattice and vertices of the surface.
fn surface(rays: f64, asked: Option<f64>) -> (f64, f64) {
    let body = |resolution: f64| VERTICES * resolution * resolution;
    match asked {
        Some(resolution) if rays < DENSE * resolution * resolution => (resolution.powi(3), 2.0 * body(resolution)),
        Some(resolution) => (resolution.powi(3), body(resolution)),
        None => {
            let (finest, coarsest) = CHOSEN;
            (finest.powi(3), (rays / RAYS_PER_VERTEX).clamp(body(coarsest), body(finest)))
        }
    }
}

/// Nodes of a volume, where the light may be put in one.
fn nodes(rays: f64, spectrum: &Spectrum, options: &Options) -> f64 {
    let (fewest, most) = NODES;
    match options.emission() {
        Emission::Auto | Emission::Volume => {
            (rays / RAYS_PER_NODE).clamp(fewest, most).min(NODE_NUMBERS / spectrum.columns.max(spectrum.bands).max(1.0))
        }
        Emission::Origins | Emission::Focus => 0.0,
    }
}

/// What the nodes of a volume need.
fn volume(rays: f64, spectrum: &Spectrum, options: &Options) -> f64 {
    nodes(rays, spectrum, options) * (NODE + NODE_BAND * spectrum.bands + NODE_COLUMN * spectrum.columns)
}

/// What `threads` threads add up: over vertices and triangles, cells of zones in both grids, those of kinds of zones, and nodes.
fn tables(rays: f64, vertices: f64, spectrum: &Spectrum, options: &Options, threads: f64) -> f64 {
    let (cells, zones) = zones(rays, spectrum, options);
    let with_columns = 3.0 + spectrum.columns;
    let of_zones = [cells * 3.0, zones * ZONE_CELLS * spectrum.columns];
    let numbers = [vertices * with_columns, 2.0 * vertices * 3.0, nodes(rays, spectrum, options) * with_columns];
    let bytes = |numbers: f64| OWN_NUMBER * (numbers * threads).min(numbers.max(MOST_OWN_NUMBERS));
    let of_kinds = if options.goniogram.zones.is_none() { of_zones } else { [0.0; 2] };
    [&numbers[..], &of_zones, &of_kinds].into_iter().flatten().map(|numbers| bytes(*numbers)).sum()
}

/// Cells of one goniogram.
fn cells_of_zone(options: &GoniogramOptions) -> f64 {
    180.0 / options.gamma_step_deg.unwrap_or(GAMMA_DEG) * 360.0 / options.c_step_deg.unwrap_or(C_DEG)
}

/// Cells of all goniograms together, and zones.
fn zones(rays: f64, spectrum: &Spectrum, options: &Options) -> (f64, f64) {
    let cells = cells_of_zone(&options.goniogram);
    match options.goniogram.zones {
        Some(zones) => {
            let zones = f64::from(zones.columns) * f64::from(zones.rows);
            (zones * cells, zones)
        }
        None => {
            let zones = (rays / RAYS_PER_ZONE).clamp(1.0, ZONES);
            let most = COLUMNS / (ZONE_CELLS * spectrum.columns.max(1.0));
            ((zones * cells).min(CELLS).max(cells), zones.min(most).max(1.0))
        }
    }
}

/// What zones and their goniograms need.
fn directions(rays: f64, spectrum: &Spectrum, options: &Options) -> f64 {
    let smoothed = cells_of_zone(&options.goniogram);
    let neighbourhoods = if options.goniogram.smooths() { SMOOTHED_CELL * smoothed } else { 0.0 };
    let (cells, zones) = zones(rays, spectrum, options);
    let band = if spectrum.is_one { ONE_SPECTRUM_BAND } else { ZONE_BAND };
    CELL * cells + zones * (band * spectrum.bands + ZONE_COLUMN * spectrum.columns) + neighbourhoods
}

/// How much there is of the spectrum.
struct Spectrum {
    bands: f64,
    columns: f64,
    /// Rays have wavelengths: every band is a column.
    by_ray: bool,
    /// All light has the spectrum of one table: in all directions the same, which is written once.
    is_one: bool,
}

impl Spectrum {
    fn of(files: &[(&Claims, &Declared)], options: &Options) -> Spectrum {
        let by_ray = files.iter().any(|(claims, declared)| claims.by_ray(declared));
        let reaches: Vec<Reach> = files.iter().map(|(claims, declared)| claims.reach(declared)).collect();
        let bands = bands::most(&options.rays, &reaches);
        let one_table = |(claims, declared): &(&Claims, &Declared)| {
            declared.spectrum.is_some() || (claims.spectrum == SpectralData::ONE_TABLE && !claims.by_ray(declared))
        };
        let is_one = files.len() == 1 && files.iter().all(one_table);
        Spectrum { bands, columns: TABLES + if by_ray { bands } else { 0.0 }, by_ray, is_one }
    }

    fn of_vertices(&self, vertices: f64, place: Spectra) -> f64 {
        let numbers = vertices * self.bands;
        let inline = match place {
            Spectra::Auto => numbers.min(MOST_INLINE),
            Spectra::Both | Spectra::Extras => numbers,
            Spectra::Attributes => 0.0,
        };
        numbers * (VERTEX_BAND + if self.by_ray { VERTEX_COLUMN } else { 0.0 }) + NUMBER * inline
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::options::Zones;
    use crate::vocabulary::declaration::Column;
    use crate::vocabulary::spectrum::Table;
    use serde_json::json;

    /// What a file claims; where its rays have wavelengths, they are visible light.
    fn claims(rays: u64, format: &str, spectrum: &str) -> Claims {
        let mut claims: Claims = serde_json::from_value(json!({
            "ray_count": rays, "format": format, "flux": {"radiant_w": 1.0, "luminous_lm": null}, "total_rule": "header",
            "has_radiant": true, "has_luminous": false, "spectrum": spectrum, "length_unit": "mm"
        }))
        .unwrap();
        claims.wavelength_nm = (spectrum == "wavelength per ray").then_some((400.0, 700.0));
        claims
    }

    fn with(change: impl Fn(&mut Options)) -> Options {
        let mut options = Options::default();
        change(&mut options);
        options
    }

    fn bands(count: usize) -> Option<Vec<f64>> {
        Some((0..=count).map(|k| 380.0 + k as f64 * 400.0 / count as f64).collect())
    }

    /// Peaks of the resident set of `lampwright build` or `serve`, less what the process had before, MiB; 2 cores x86-64, release.
    /// The last number: how much more is said at most.
    #[test]
    fn it_bounds_what_was_measured() {
        let zoned = |options: &mut Options| {
            (options.goniogram.zones, options.rays.band_edges_nm) = (Some(Zones { columns: 8, rows: 8 }), bands(4096));
        };
        let fine = |options: &mut Options| {
            (options.goniogram.gamma_step_deg, options.goniogram.c_step_deg) = (Some(0.5), Some(4.0));
        };
        let [plain, by_ray] = ["table", "wavelength per ray"];
        for (source, rays, spectrum, threads, options, measured, most) in [
            ("dome", 100_000, plain, 2, Options::default(), 84.0, 4.0),
            ("dome", 1_000_000, plain, 2, Options::default(), 84.0, 4.0),
            ("dome", 100_000, plain, 2, with(|o| o.hull.resolution = Some(256)), 260.0, 7.0),
            ("dome", 1_000_000, plain, 2, with(|o| o.hull.resolution = Some(256)), 254.0, 4.0),
            ("dome", 1_000_000, plain, 2, with(|o| o.rays.band_edges_nm = bands(1000)), 239.0, 3.0),
            ("dome", 1_000_000, plain, 2, with(|o| o.rays.band_edges_nm = bands(4096)), 772.0, 3.0),
            ("dome", 1_000_000, plain, 2, with(zoned), 769.0, 3.0),
            ("dome", 1_000_000, plain, 2, with(fine), 123.0, 6.0),
            (
                "dome",
                1_000_000,
                plain,
                2,
                with(|o| o.goniogram.zones = Some(Zones { columns: 32, rows: 32 })),
                143.0,
                6.0,
            ),
            ("cylinder", 100_000, plain, 2, Options::default(), 54.0, 4.0),
            ("cylinder", 100_000, plain, 2, with(|o| o.hull.resolution = Some(256)), 1142.0, 2.0),
            ("cylinder", 1_000_000, plain, 2, Options::default(), 84.0, 6.0),
            ("cylinder", 1_000_000, plain, 2, with(|o| o.hull.resolution = Some(256)), 262.0, 4.0),
            ("cylinder", 1_000_000, plain, 2, with(fine), 129.0, 6.0),
            ("four chips", 100_000, by_ray, 2, Options::default(), 87.0, 4.0),
            ("four chips", 1_000_000, by_ray, 2, Options::default(), 91.0, 5.0),
            ("four chips", 100_000, by_ray, 2, with(|o| o.rays.band_edges_nm = bands(4096)), 244.0, 5.0),
            ("four chips", 1_000_000, by_ray, 2, with(|o| o.rays.band_edges_nm = bands(1000)), 252.0, 7.0),
            ("four chips", 1_000_000, by_ray, 2, with(|o| o.rays.band_edges_nm = bands(2500)), 459.0, 7.0),
            ("four chips", 1_000_000, by_ray, 2, with(|o| o.hull.resolution = Some(256)), 157.0, 10.0),
        ] {
            let (claims, declared) = (claims(rays, "IES TM-25", spectrum), Declared::default());
            let on = |threads| estimate(&[(&claims, &declared)], &options, threads);
            let said = on(threads).bytes as f64 / MIB;
            println!(
                "{source}, {rays} rays, {threads} threads: measured {measured}, said {said:.0}, {:.1} times",
                said / measured
            );
            assert!(said >= measured && said <= most * measured, "{source}, {rays} rays: {said:.0} for {measured}");
            for more in [1, 6, 62] {
                let MemoryNeed { bytes, thread_bytes } = on(threads);
                assert!(bytes + more as u64 * thread_bytes + 1 >= on(threads + more).bytes, "{source}: {more} more");
            }
        }
    }

    /// Default bands follow the wavelengths: 40 from 380 to 780 nm, 10 nm each, and no more than 400.
    #[test]
    fn bands_are_counted_where_the_light_is() {
        let columns = [Column::X, Column::Y, Column::Z, Column::L, Column::M, Column::N, Column::Flux];
        let named = |last: &[Column]| Declared { columns: Some([&columns, last].concat()), ..Declared::default() };
        let table = |points: &[(f64, f64)]| Declared { spectrum: Table::new(points), ..Declared::default() };
        let of = |claims: &Claims, declared: &Declared| {
            let spectrum = Spectrum::of(&[(claims, declared)], &Options::default());
            (spectrum.bands, spectrum.by_ray)
        };
        let [text, by_ray, plain] =
            [("text columns", "none"), ("IES TM-25", "wavelength per ray"), ("IES TM-25", "none")]
                .map(|(format, spectrum)| claims(1000, format, spectrum));
        let found = |range| {
            let mut claims = by_ray.clone();
            claims.wavelength_nm = range;
            claims
        };
        let mut tables = claims(1000, "IES TM-25", "table");
        tables.table_range_nm = Some((300.0, 780.0));
        let nothing = Declared::default();
        for (claims, declared, expected) in [
            (&plain, &nothing, (40.0, false)),
            (&by_ray, &nothing, (40.0, true)),
            (&found(None), &nothing, (400.0, true)),
            (&found(Some((201.0, 999.0))), &nothing, (80.0, true)),
            (&found(Some((300.0, 9000.0))), &nothing, (40.0, true)), // too far apart: it stays as it is
            (&found(None), &table(&[(300.0, 1.0), (400.0, 1.0)]), (48.0, false)),
            (&tables, &nothing, (48.0, false)),
            (&text, &nothing, (40.0, false)),
            (&text, &named(&[]), (40.0, false)),
            (&text, &named(&[Column::WavelengthNm]), (400.0, true)),
            (&text, &named(&[Column::WavelengthUm]), (400.0, true)),
        ] {
            assert_eq!(of(claims, declared), expected, "{claims:?} {declared:?}");
        }
    }
}
