//! A model made by hand, whose every number has a closed form: a flat Lambertian rectangle, 2 mm along X and 1 mm along Y in the
//! plane z = 0, looking along +Z, of uniform exitance, its left zone bluer than its right one.

use crate::flux::balance::{Balance, Share};
use crate::flux::{Amounts, Surface};
use crate::goniogram::Mixture;
use crate::goniogram::intensity::Quality;
use crate::goniogram::zone::Place;
use crate::goniogram::{Goniogram, Goniograms, Lattice, SphereGrid, Zone};
use crate::hull::{Hull, Label};
use crate::model::Model;
use crate::model::channel::Origin;
use crate::source::{Columns, Spectral};
use crate::vocabulary::declaration::Declared;
use crate::vocabulary::notice::Notices;
use crate::vocabulary::space::{Axis, Bounds, Frame};
use crate::vocabulary::spectrum::{Bands, lm_per_w};
use crate::vocabulary::units::{Flux, LengthUnit};
use crate::volume::Volume;
use crate::volume::lattice::VolumeLattice;
use glam::DVec3;
use std::f64::consts::{FRAC_PI_2, PI};

/// Radiant flux of the whole, W.
pub const FLUX_W: f64 = 5.0;
/// Vertices along X and Y.
const COLUMNS: usize = 9;
const ROWS: usize = 5;
/// Shares of the bands in the radiant flux of each zone.
const SHARES: [[f64; 3]; 2] = [[0.6, 0.3, 0.1], [0.2, 0.3, 0.5]];
const EDGES_NM: [f64; 4] = [440.0, 460.0, 540.0, 640.0];

/// The model, with `pattern(direction)` (per sr, any scale) the same in both zones; mind that the pattern is sampled at nodes.
pub fn model_with(pattern: impl Fn(DVec3) -> f64) -> Model {
    let grid = SphereGrid::new(36, 36);
    let frame = Frame { nadir: Axis::PosZ, c0: Axis::PosX };
    let cells: Vec<f64> = grid.cell_nodes().iter().map(|(c, gamma)| pattern(frame.direction(*c, *gamma))).collect();
    assemble(grid, &cells)
}

/// The Lambertian model: the mean of cos γ over each cell, in closed form, so that the cells hold the exact flux.
pub fn model() -> Model {
    let grid = SphereGrid::new(36, 36);
    assemble(grid.clone(), &lambertian_cells(&grid))
}

/// The same light in two cells of 1 mm side by side.
pub fn with_volume() -> Model {
    let model = model();
    let vertices = &model.surface.vertices;
    let bounds = Bounds { min: DVec3::ZERO, max: DVec3::new(2.0, 1.0, 1.0) };
    let lattice = VolumeLattice::all_lit(bounds, 2.0);
    let share = 1.0 / lattice.node_count as f64;
    let spread = |total: f64| vec![share * total; lattice.node_count];
    let of = |values: &Option<Vec<f64>>| values.as_ref().map(|values| spread(values.iter().sum()));
    let totals: Vec<f64> = vertices.column_totals().iter().map(|total| share * total).collect();
    let nodes = Amounts {
        rays: spread(vertices.rays.iter().sum()),
        radiant_w: of(&vertices.radiant_w),
        luminous_lm: of(&vertices.luminous_lm),
        columns: totals.repeat(lattice.node_count),
        column_count: vertices.column_count,
    };
    let volume = Volume { volumes_mm3: lattice.volumes_mm3(), lattice, nodes };
    Model { volume: Some(volume), ..model }
}

/// ∫ cos γ dω / ∫ dω over each cell, light on the γ < 90° half only.
fn lambertian_cells(grid: &SphereGrid) -> Vec<f64> {
    let step = PI / (grid.gamma_nodes() - 1) as f64;
    let edge = |gamma: f64| gamma.clamp(0.0, FRAC_PI_2).sin().powi(2) / 2.0;
    let cap = |gamma: f64| gamma.clamp(0.0, PI).cos();
    let mean = |gamma: f64| {
        let (from, to) = (gamma - step / 2.0, gamma + step / 2.0);
        (edge(to) - edge(from)) / (cap(from) - cap(to))
    };
    grid.cell_nodes().iter().map(|(_, gamma)| mean(*gamma)).collect()
}

/// Both zones share the pattern of `cells`; the spectral grid is coarser by three.
fn assemble(grid: SphereGrid, cells: &[f64]) -> Model {
    let spectral_grid = SphereGrid::new(12, 12);
    let hull = rectangle();
    let spectral = Spectral { bands: Bands::new(EDGES_NM.to_vec()).unwrap(), columns: Columns::Bands };
    let frame = Frame { nadir: Axis::PosZ, c0: Axis::PosX };
    let zone_of_vertex: Vec<u32> = hull.vertices_mm.iter().map(|vertex| u32::from(vertex.x >= 0.0)).collect();
    let surface = surface(&hull, &zone_of_vertex);
    let zones: Vec<Zone> =
        (0..2).map(|id| zone(id, &hull, &surface, &zone_of_vertex, &grid, cells, &spectral)).collect();
    let mut total = goniogram(&surface, &zone_of_vertex, |_| true, &grid, cells, &spectral);
    for (at, value) in total.spectral_w_per_sr_nm.iter_mut().enumerate() {
        *value = zones.iter().map(|zone| zone.goniogram.spectral_w_per_sr_nm[at]).sum();
    }
    let lattice = Lattice { frame, columns: 2, rows: 1, min_mm: [-1.0, -0.5], max_mm: [1.0, 0.5] };
    let flux = surface.vertices.total();
    let goniograms = Goniograms {
        frame,
        lattice: Some(lattice),
        grid,
        spectral_grid,
        zones,
        mixtures: zone_of_vertex.iter().map(|zone| Mixture::hard(*zone)).collect(),
        zone_of_vertex,
        total,
        notices: Notices::default(),
    };
    Model {
        origins: vec![origin(flux)],
        ancestors: Vec::new(),
        flux,
        spectral,
        hull,
        surface,
        goniograms,
        volume: None,
        study: None,
        notices: Vec::new(),
    }
}

fn origin(flux: Flux) -> Origin {
    let text = |name: &str, value: &str| (name.to_owned(), value.to_owned());
    Origin {
        name: "rectangle.tm25ray".to_owned(),
        channel: "rectangle".to_owned(),
        sha256: "ab".repeat(32),
        byte_count: 4242,
        format: "IES TM-25",
        ray_count: 1001,
        rays_used: 1000,
        flux,
        fixed: None,
        declared: Declared { name: Some("rectangle".to_owned()), ..Declared::default() },
        length_unit: Some(LengthUnit::Millimetre),
        spectrum: "table",
        header_flux: flux,
        ray_sum: flux,
        header_over_sum: Some(1.0),
        texts: vec![text("creation date", "2013-10-16T07:00:00Z"), text("manufacturer", "Nobody & Sons")],
    }
}

fn rectangle() -> Hull {
    let at = |column: usize, row: usize| (row * COLUMNS + column) as u32;
    let vertices_mm = (0..ROWS)
        .flat_map(|row| {
            (0..COLUMNS).map(move |column| DVec3::new(column as f64 * 0.25 - 1.0, row as f64 * 0.25 - 0.5, 0.0))
        })
        .collect();
    let triangles: Vec<[u32; 3]> = (0..ROWS - 1)
        .flat_map(|row| (0..COLUMNS - 1).map(move |column| (column, row)))
        .flat_map(|(column, row)| {
            let [a, b] = [at(column, row), at(column + 1, row)];
            let [c, d] = [at(column + 1, row + 1), at(column, row + 1)];
            [[a, b, c], [a, c, d]]
        })
        .collect();
    let labels = (0..triangles.len())
        .map(|triangle| [Label::Projected, Label::Projected, Label::Stitched, Label::Filled][triangle % 4])
        .collect();
    Hull {
        vertices_mm,
        triangles,
        labels,
        part_of_vertex: vec![0; ROWS * COLUMNS],
        face_of_vertex: vec![0; ROWS * COLUMNS],
        place_of_vertex: (0..(ROWS * COLUMNS) as u32).collect(),
        cell_mm: DVec3::new(0.25, 0.25, 1e-6),
        resolution: 8,
        max_edge_mm: 0.5,
        focal: None,
        notices: Notices::default(),
    }
}

/// Uniform exitance: flux goes with area.
fn surface(hull: &Hull, zone_of_vertex: &[u32]) -> Surface {
    let per_mm2 = FLUX_W / hull.total_area_mm2();
    let areas = hull.vertex_areas_mm2();
    let shares = |vertex: usize| SHARES[zone_of_vertex[vertex] as usize];
    let vertices = amounts(&areas, per_mm2, shares, 1);
    let triangle_areas: Vec<f64> = (0..hull.triangles.len()).map(|triangle| hull.area_mm2(triangle)).collect();
    // A triangle's luminous flux is what its corners give it.
    let mut triangles = amounts(&triangle_areas, per_mm2, |_| SHARES[0], 0);
    let luminous = triangles.luminous_lm.as_mut().unwrap();
    for (triangle, corners) in hull.triangles.iter().enumerate() {
        let efficacy: f64 = corners.iter().map(|vertex| efficacy(shares(*vertex as usize)) / 3.0).sum();
        luminous[triangle] = per_mm2 * triangle_areas[triangle] * efficacy;
    }
    let flux = vertices.total();
    let all = Share { rays: 1000, flux };
    let none = Share { rays: 0, flux: Flux { radiant_w: Some(0.0), luminous_lm: Some(0.0) } };
    let balance = Balance {
        incoming: all,
        hit: all,
        snapped: none,
        rejected: none,
        on_triangles: flux,
        on_vertices: flux,
        after_smoothing: flux,
    };
    let ray = Flux { radiant_w: Some(1e-3), luminous_lm: Some(1e-1) };
    Surface { triangles, vertices, ray, balance, notices: Notices::default() }
}

fn amounts(areas: &[f64], per_mm2: f64, shares: impl Fn(usize) -> [f64; 3], columns: usize) -> Amounts {
    let watts: Vec<f64> = areas.iter().map(|area| area * per_mm2).collect();
    let lumens = watts.iter().enumerate().map(|(site, watt)| watt * efficacy(shares(site))).collect();
    // Three bands and what lies outside them: nothing.
    let column = |(site, watt): (usize, &f64)| {
        let [blue, green, red] = shares(site);
        [blue * watt, green * watt, red * watt, 0.0]
    };
    Amounts {
        rays: vec![1000.0 / areas.len() as f64; areas.len()],
        radiant_w: Some(watts.clone()),
        luminous_lm: Some(lumens),
        columns: if columns > 0 { watts.iter().enumerate().flat_map(column).collect() } else { Vec::new() },
        column_count: 4 * columns,
    }
}

/// Lines at the middles of the bands, lm/W.
fn efficacy(shares: [f64; 3]) -> f64 {
    shares.iter().zip(EDGES_NM.windows(2)).map(|(share, edge)| share * lm_per_w(0.5 * (edge[0] + edge[1]))).sum()
}

fn zone(
    id: u32,
    hull: &Hull,
    surface: &Surface,
    zone_of_vertex: &[u32],
    grid: &SphereGrid,
    cells: &[f64],
    spectral: &Spectral,
) -> Zone {
    let own: Vec<usize> = (0..hull.vertices_mm.len()).filter(|vertex| zone_of_vertex[*vertex] == id).collect();
    let bounds_mm = Bounds::of(own.iter().map(|vertex| hull.vertices_mm[*vertex]));
    Zone {
        id,
        place: Some(Place { row: 0, column: id as usize }),
        bounds_mm,
        centroid_mm: bounds_mm.center(),
        area_mm2: own.iter().map(|vertex| hull.vertex_areas_mm2()[*vertex]).sum(),
        vertex_count: own.len(),
        goniogram: goniogram(surface, zone_of_vertex, |zone| zone == id, grid, cells, spectral),
    }
}

fn goniogram(
    surface: &Surface,
    zone_of_vertex: &[u32],
    belongs: impl Fn(u32) -> bool,
    grid: &SphereGrid,
    cells: &[f64],
    spectral: &Spectral,
) -> Goniogram {
    let own = |values: &[f64]| -> f64 {
        values.iter().zip(zone_of_vertex).filter(|(_, zone)| belongs(**zone)).map(|(value, _)| value).sum()
    };
    let radiant_w = own(surface.vertices.radiant_w.as_ref().unwrap());
    let luminous_lm = own(surface.vertices.luminous_lm.as_ref().unwrap());
    let whole: f64 = cells.iter().zip(grid.cell_solid_angles_sr()).map(|(value, sr)| value * sr).sum();
    let scaled =
        |flux: f64| grid.nodes_from_cells(&cells.iter().map(|value| value * flux / whole).collect::<Vec<f64>>());
    let mut columns = vec![0.0; 4];
    for (vertex, zone) in zone_of_vertex.iter().enumerate() {
        if belongs(*zone) {
            columns.iter_mut().zip(surface.vertices.columns_of(vertex)).for_each(|(sum, watt)| *sum += watt);
        }
    }
    let spectral_flux = spectral.bands_w_per_nm(&columns);
    let coarse = SphereGrid::new(12, 12);
    let pattern = lambertian_cells(&coarse);
    let spectral_nodes = coarse.nodes_from_cells(&pattern);
    Goniogram {
        rays: if radiant_w < FLUX_W * 0.99 { 500.0 } else { 1000.0 },
        flux: Flux { radiant_w: Some(radiant_w), luminous_lm: Some(luminous_lm) },
        luminous_cd: Some(scaled(luminous_lm)),
        radiant_w_per_sr: Some(scaled(radiant_w)),
        spectral_w_per_sr_nm: spectral_nodes
            .iter()
            .flat_map(|value| spectral_flux.iter().map(move |flux| value / PI * flux))
            .collect(),
        spectral_flux_w_per_nm: spectral_flux,
        quality: Quality {
            rays_per_cell_median: 1.5,
            empty_cell_fraction: 0.5,
            relative_noise_at_peak: 0.04,
            smoothing_deg: 0.0,
        },
    }
}
