// The photometric solid: from its middle to its surface it is as far as the intensity that way is great.
import { falseColours } from "./colour.js";
import { intensities } from "./facts.js";

/** Fewest half-planes of C that look round. */
const FEWEST_PLANES = 48;
const COLUMNS = 9;
/** Part of the picture's radius that the solid has: its caption and its controls lie in the corners. */
const FILLED = 0.85;

/** Intensity in any direction, bilinear between nodes as everywhere. */
export function intensityAt(lamp, c, gamma) {
  const { grid } = intensities(lamp, lamp.goniograms.total);
  return lamp.directions.nodes(c, gamma).reduce((sum, [j, k, weight]) => sum + weight * grid[j][k], 0);
}

/** The greatest intensity at a node. */
export function peakOf(lamp) {
  return Math.max(...intensities(lamp, lamp.goniograms.total).grid.flat(), 1e-30);
}

/**
 * The solid of a lamp: `positions`, `indices`, and `rows` of position, normal and colour for the picture. The directions begin at `origin`,
 * and the greatest intensity is `reach` mm from there: so that the solid nearly fills a sphere of `radius` about `middle`; where two are compared
 * (`lamp.solidPeak` is the greatest of both), both begin at `middle` and reach as far as that sphere.
 */
export function solidOf(lamp, middle, radius) {
  const solid = about(lamp, middle, radius);
  if (lamp.solidPeak) return { ...solid, origin: middle, reach: radius, rows: rowsOf(solid) };
  const { positions } = solid;
  const sides = [0, 1, 2].map((axis) => {
    const all = positions.filter((_, k) => k % 3 === axis);
    return [all.reduce((a, b) => Math.min(a, b)), all.reduce((a, b) => Math.max(a, b))];
  });
  const center = sides.map(([low, high]) => (low + high) / 2);
  let most = 0;
  for (let k = 0; k < positions.length; k += 3) most = Math.max(most, Math.hypot(...center.map((value, axis) => positions[k + axis] - value)));
  const scale = most > 0 ? (FILLED * radius) / most : 1;
  const placed = { ...solid, positions: positions.map((value, k) => middle[k % 3] + scale * (value - center[k % 3])) };
  return { ...placed, origin: middle.map((value, axis) => value + scale * (value - center[axis])), reach: scale * radius, rows: rowsOf(placed) };
}

/** The solid whose greatest intensity is at `radius` from `middle`, where its directions begin. */
function about(lamp, middle, radius) {
  const { directions } = lamp;
  const peak = lamp.solidPeak ?? peakOf(lamp);
  const planes = directions.c.length >= FEWEST_PLANES ? directions.c : Array.from({ length: FEWEST_PLANES }, (_, k) => (360 / FEWEST_PLANES) * k);
  const gammas = directions.gamma;
  const corners = planes.length * gammas.length;
  const positions = new Float32Array(3 * corners);
  const parts = new Float32Array(corners);
  planes.forEach((c, j) => gammas.forEach((gamma, k) => {
    const at = j * gammas.length + k;
    parts[at] = intensityAt(lamp, c, gamma) / peak;
    positions.set(directions.vector(c, gamma).map((value, axis) => middle[axis] + radius * parts[at] * value), 3 * at);
  }));
  const indices = new Uint32Array(6 * planes.length * (gammas.length - 1));
  planes.forEach((_, j) => gammas.slice(1).forEach((__, k) => {
    const [a, b] = [j * gammas.length + k, ((j + 1) % planes.length) * gammas.length + k];
    indices.set([a, a + 1, b, b, a + 1, b + 1], 6 * (j * (gammas.length - 1) + k));
  }));
  return { positions, indices, parts };
}

function rowsOf({ positions, indices, parts }) {
  const normals = normalsOf(positions, indices);
  const colours = falseColours();
  const rows = new Float32Array(COLUMNS * parts.length);
  parts.forEach((part, corner) => {
    const shade = 4 * Math.round(255 * Math.min(1, part));
    rows.set(positions.subarray(3 * corner, 3 * corner + 3), COLUMNS * corner);
    rows.set(normals.subarray(3 * corner, 3 * corner + 3), COLUMNS * corner + 3);
    rows.set([0, 1, 2].map((axis) => colours[shade + axis] / 255), COLUMNS * corner + 6);
  });
  return rows;
}

/** Normals at corners: the sum of those of their triangles, by area. */
function normalsOf(positions, indices) {
  const out = new Float32Array(positions.length);
  const edge = (from, to) => [0, 1, 2].map((axis) => positions[3 * to + axis] - positions[3 * from + axis]);
  for (let k = 0; k < indices.length; k += 3) {
    const [a, b, c] = indices.subarray(k, k + 3);
    const [u, v] = [edge(a, b), edge(a, c)];
    const cross = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    for (const corner of [a, b, c]) cross.forEach((value, axis) => { out[3 * corner + axis] += value; });
  }
  return out;
}
