// A model as its own files say it: surface or volume with M or j, zones with q. openapi/README.md has the formulas.
import { weigher } from "./colour.js";
import { parseGlb } from "./glb.js";
import { Directions, normalised } from "./goniogram.js";

/** Places (vertices of a surface, nodes of a volume) with their light per area or volume: `[X, Y, Z, radiant]` in turn. Light that is known in W
 * only is grey by its W; that of a lamp whose lm are known is dark where it has none. */
function densities(read, attributes, sizes, { spectrum, isLuminous }, extras) {
  const of = (name) => (attributes[name] === undefined ? null : read(attributes[name]));
  const [lm, w, own] = [of("_FLUX_LM"), of("_FLUX_W"), of("_XYZ_LM")];
  const bands = spectrum ? spectrum.wavelength_nm.map((_, band) => of(`_SPECTRUM_${String(band).padStart(3, "0")}`) ?? extras?.[band]) : null;
  const weigh = spectrum ? weigher(spectrum.band_edges_nm) : null;
  const out = new Float32Array(4 * sizes.length);
  for (let place = 0; place < sizes.length; place += 1) {
    if (!(sizes[place] > 0)) continue;
    let xyz = [0, 0, 0];
    if (own) xyz = [own[3 * place], own[3 * place + 1], own[3 * place + 2]];
    else if (bands?.[0]) xyz = weigh(bands.map((band) => band[place]));
    const y = lm ? lm[place] : xyz[1];
    const grey = isLuminous && xyz[1] > 0 ? null : isLuminous ? y : w ? w[place] : 0;
    const [x, z] = grey === null ? [(xyz[0] * y) / xyz[1], (xyz[2] * y) / xyz[1]] : [0.9505 * grey, 1.089 * grey];
    out.set([x, grey ?? y, z, w ? w[place] : 0].map((value) => value / sizes[place]), 4 * place);
  }
  return out;
}

/** The spectra of vertices by band where they stand in extras only. */
function listed(extras) {
  const dense = extras?.vertex_spectra;
  if (!dense?.values) return null;
  const [vertices, bands] = dense.shape;
  return Array.from({ length: bands }, (_, band) => Float32Array.from({ length: vertices }, (__, vertex) => dense.scale * dense.values[vertex][band]));
}

export class Lamp {
  constructor(glb, goniograms) {
    const { document, read } = parseGlb(glb);
    const [surface] = document.meshes[0].primitives;
    const extras = document.meshes[0].extras.emitter;
    const attributes = surface.attributes;
    this.goniograms = goniograms;
    this.extras = extras;
    // An infrared lamp has 0 lm: it is shown in W.
    this.isLuminous = (goniograms.total.flux_lm ?? 0) > 0;
    this.isRadiant = attributes._FLUX_W !== undefined;
    this.spectrum = goniograms.spectrum ?? extras.spectrum ?? null;
    this.hasColour = this.isLuminous && (Boolean(this.spectrum) || attributes._XYZ_LM !== undefined);
    this.weigh = this.spectrum ? weigher(this.spectrum.band_edges_nm) : null;
    this.directions = new Directions(goniograms, goniograms.grid);
    this.positions = millimetres(read(attributes.POSITION));
    this.indices = read(surface.indices);
    this.stages = extras.triangle_stage;
    this.zoneIds = read(attributes._ZONES);
    this.zoneWeights = read(attributes._ZONE_WEIGHTS);
    this.areas = this.vertexAreas();
    this.exitance = densities(read, attributes, this.areas, this, listed(extras));
    const total = normalised(goniograms.total, this.directions, this.spectrum, this.weigh, null);
    this.q = goniograms.zones.map((zone) => normalised(zone, this.directions, this.spectrum, this.weigh, total));
    this.total = total;
    this.volume = extras.volume ? volumeOf(document, read, extras.volume, this) : null;
    this.box = boxOf(this.volume ? this.volume.points : this.positions);
  }

  get triangles() {
    return this.indices.length / 3;
  }

  corner(triangle, corner) {
    const at = 3 * this.indices[3 * triangle + corner];
    return [this.positions[at], this.positions[at + 1], this.positions[at + 2]];
  }

  /** Unit normal and area of a triangle, mm². */
  normal(triangle) {
    const [a, b, c] = [0, 1, 2].map((k) => this.corner(triangle, k));
    const [u, v] = [b, c].map((point) => point.map((value, k) => value - a[k]));
    const cross = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    const length = Math.hypot(...cross) || 1e-30;
    return { normal: cross.map((value) => value / length), area: length / 2 };
  }

  /** A third of the area of the triangles at each vertex, mm². */
  vertexAreas() {
    const areas = new Float64Array(this.positions.length / 3);
    for (let triangle = 0; triangle < this.triangles; triangle += 1) {
      const { area } = this.normal(triangle);
      for (let k = 0; k < 3; k += 1) areas[this.indices[3 * triangle + k]] += area / 3;
    }
    return areas;
  }

  /** Zones of a triangle, with the weight of each at its three corners. */
  mixture(triangle) {
    const found = new Map();
    for (let corner = 0; corner < 3; corner += 1) {
      const vertex = this.indices[3 * triangle + corner];
      for (let place = 0; place < 4; place += 1) {
        const weight = this.zoneWeights[4 * vertex + place];
        if (!(weight > 0)) continue;
        const zone = this.zoneIds[4 * vertex + place];
        if (!found.has(zone)) found.set(zone, [0, 0, 0]);
        found.get(zone)[corner] += weight;
      }
    }
    return found;
  }

  /** Where a line from `eye` along `way` first meets the surface (see `meets`). */
  meet(eye, way, cuts) {
    return meets(this.positions, this.indices, eye, way, cuts);
  }

  /** The zone with the greatest weight at a point of a triangle. */
  zoneAt({ triangle, weights }) {
    let [zone, most] = [null, -1];
    for (const [id, corners] of this.mixture(triangle)) {
      const weight = corners.reduce((sum, value, k) => sum + value * weights[k], 0);
      if (weight > most) [zone, most] = [id, weight];
    }
    return zone;
  }
}

/**
 * Where a line from `eye` along `way` first meets one of the triangles, on the side of the planes `cuts` that is shown: triangle,
 * barycentric weights, distance, point; null where it meets none. (Möller and Trumbore, "Fast, minimum storage ray/triangle
 * intersection", 1997.)
 */
export function meets(positions, indices, [ex, ey, ez], [dx, dy, dz], cuts = []) {
  let best = null;
  for (let triangle = 0; 3 * triangle < indices.length; triangle += 1) {
    const [a, b, c] = [3 * indices[3 * triangle], 3 * indices[3 * triangle + 1], 3 * indices[3 * triangle + 2]];
    const [ax, ay, az] = [positions[a], positions[a + 1], positions[a + 2]];
    const [ux, uy, uz] = [positions[b] - ax, positions[b + 1] - ay, positions[b + 2] - az];
    const [vx, vy, vz] = [positions[c] - ax, positions[c + 1] - ay, positions[c + 2] - az];
    const [px, py, pz] = [dy * vz - dz * vy, dz * vx - dx * vz, dx * vy - dy * vx];
    const determinant = ux * px + uy * py + uz * pz;
    if (Math.abs(determinant) < 1e-14) continue;
    const [wx, wy, wz] = [ex - ax, ey - ay, ez - az];
    const beta = (wx * px + wy * py + wz * pz) / determinant;
    if (beta < 0 || beta > 1) continue;
    const [rx, ry, rz] = [wy * uz - wz * uy, wz * ux - wx * uz, wx * uy - wy * ux];
    const gamma = (dx * rx + dy * ry + dz * rz) / determinant;
    if (gamma < 0 || beta + gamma > 1) continue;
    const distance = (vx * rx + vy * ry + vz * rz) / determinant;
    if (distance <= 0 || (best && distance >= best.distance)) continue;
    const point = [ex + distance * dx, ey + distance * dy, ez + distance * dz];
    if (cuts.some(([nx, ny, nz, most]) => nx * point[0] + ny * point[1] + nz * point[2] > most)) continue;
    best = { triangle, weights: [1 - beta - gamma, beta, gamma], distance, point };
  }
  return best;
}

/** glTF metres, Y up, as the source's millimetres. */
function millimetres(gltf) {
  const out = new Float32Array(gltf.length);
  for (let k = 0; k < gltf.length; k += 3) out.set([1000 * gltf[k], -1000 * gltf[k + 2], 1000 * gltf[k + 1]], k);
  return out;
}

function boxOf(positions) {
  const box = { min: [Infinity, Infinity, Infinity], max: [-Infinity, -Infinity, -Infinity] };
  for (let k = 0; k < positions.length; k += 1) {
    box.min[k % 3] = Math.min(box.min[k % 3], positions[k]);
    box.max[k % 3] = Math.max(box.max[k % 3], positions[k]);
  }
  return box;
}

/** A volume as two dense lattices: j at nodes, and which cells are lit. */
function volumeOf(document, read, facts, lamp) {
  const { attributes } = document.meshes[0].primitives[facts.primitive];
  const points = millimetres(read(attributes.POSITION));
  const light = densities(read, attributes, read(attributes._VOLUME_MM3), lamp, null);
  const [nx, ny, nz] = facts.cells;
  const nodes = new Float32Array(4 * (nx + 1) * (ny + 1) * (nz + 1));
  const pitch = [facts.pitch_mm].flat();
  const step = (axis) => pitch[axis] ?? pitch[0];
  for (let node = 0; node < points.length / 3; node += 1) {
    const [i, j, k] = [0, 1, 2].map((axis) => Math.round((points[3 * node + axis] - facts.min_mm[axis]) / step(axis)));
    nodes.set(light.subarray(4 * node, 4 * node + 4), 4 * ((k * (ny + 1) + j) * (nx + 1) + i));
  }
  const lit = new Uint8Array(nx * ny * nz);
  let [cell, isLit] = [0, false];
  for (const run of facts.lit_runs) {
    if (isLit) lit.fill(255, cell, cell + run);
    cell += run;
    isLit = !isLit;
  }
  return { points, nodes, lit, cells: facts.cells, min: facts.min_mm, pitch: [0, 1, 2].map(step), greatest: light };
}
