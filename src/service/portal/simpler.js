// The surface of a lamp with fewer triangles, for pictures that move where drawing all of them takes too long: vertices that lie near each
// other become one. What these few send towards the eye is found here: without a graphics card, a shader takes longer.

/** Cells of the lattice along each axis: three of these numbers, a zone and a side are one whole number. */
const MOST_CELLS = 2048;
const DEG = 180 / Math.PI;

/** Six sides that a surface can look to: sheets that lie back to back stay two. */
function sideOf(x, y, z) {
  const [wide, deep, tall] = [Math.abs(x), Math.abs(y), Math.abs(z)];
  if (tall >= wide && tall >= deep) return z < 0 ? 1 : 0;
  if (wide >= deep) return x < 0 ? 3 : 2;
  return y < 0 ? 5 : 4;
}

/** Numbers of a vertex as they are drawn: its place, and M q towards the eye. */
export const DRAWN = 7;

/**
 * Columns of vertices (`places`, `light`, `zones`, `weights`) and the order in which they make about `most` triangles. In each cell of a lattice
 * the vertices of one zone that look to one side are one vertex: at the place of that with the fewest triangles, because the corners and
 * rims of a sheet have fewer than its inside, and outlines stay where they are; with the mean of their light by area.
 */
export function simpler(lamp, most) {
  const count = lamp.positions.length / 3;
  const seen = about(lamp, count);
  let pitch = Math.sqrt((2 * seen.area) / most) || 1;
  let found = merge(lamp, count, seen, pitch);
  // Where zones and sides meet, cells have several vertices: wider cells have fewer.
  for (let tries = 0; tries < 3 && found.indices.length > 3 * 1.3 * most; tries += 1) {
    pitch *= Math.sqrt(found.indices.length / (3 * most));
    found = merge(lamp, count, seen, pitch);
  }
  return { vertices: inColumns(found.vertices), indices: found.indices };
}

function merge(lamp, count, { sums, uses }, pitch) {
  const cells = new Map();
  const cellOf = new Uint32Array(count);
  for (let k = 0; k < count; k += 1) {
    let key = 6 * mainZone(lamp, k) + sideOf(sums[3 * k], sums[3 * k + 1], sums[3 * k + 2]);
    for (let axis = 0; axis < 3; axis += 1) key = key * MOST_CELLS + Math.min(MOST_CELLS - 1, Math.floor((lamp.positions[3 * k + axis] - lamp.box.min[axis]) / pitch));
    if (!cells.has(key)) cells.set(key, { index: cells.size, vertices: [] });
    const cell = cells.get(key);
    cell.vertices.push(k);
    cellOf[k] = cell.index;
  }
  return { vertices: [...cells.values()].map(({ vertices }) => merged(lamp, vertices, uses)), indices: corners(lamp.indices, cellOf) };
}

/**
 * Puts the vertices as they are drawn into `rows`: what they send towards the eye, in units of `scale`; q is bilinear between nodes, as
 * everywhere. It is done for each picture, so it makes nothing new, and looks for the nodes of a vertex from those of the one before.
 */
export function send(lamp, { places, light, zones, weights }, eye, scale, rows) {
  const { directions: { x, y, z, c, gamma }, q } = lamp;
  const [last, planes] = [gamma.length - 2, c.length];
  let k = 0;
  for (let vertex = 0; vertex < places.length / 3; vertex += 1) {
    const [at, row] = [3 * vertex, DRAWN * vertex];
    const wide = eye[0] - places[at], deep = eye[1] - places[at + 1], tall = eye[2] - places[at + 2];
    const px = x[0] * wide + x[1] * deep + x[2] * tall, py = y[0] * wide + y[1] * deep + y[2] * tall;
    const from = Math.atan2(Math.sqrt(px * px + py * py), -(z[0] * wide + z[1] * deep + z[2] * tall)) * DEG;
    while (k > 0 && from < gamma[k]) k -= 1;
    while (k < last && from >= gamma[k + 1]) k += 1;
    const t = (from - gamma[k]) / (gamma[k + 1] - gamma[k]);
    const turn = ((Math.atan2(py, px) * DEG + 360) % 360) * (planes / 360);
    const j = Math.floor(turn) % planes, s = planes === 1 ? 0 : turn - Math.floor(turn);
    const near = 4 * (j * gamma.length + k), far = 4 * (((j + 1) % planes) * gamma.length + k);
    rows[row] = places[at];
    rows[row + 1] = places[at + 1];
    rows[row + 2] = places[at + 2];
    for (let part = 0; part < 4; part += 1) {
      let sum = 0;
      for (let slot = 4 * vertex; slot < 4 * vertex + 4 && weights[slot] > 0; slot += 1) {
        const table = q[zones[slot]];
        const one = table[near + part] + t * (table[near + 4 + part] - table[near + part]);
        sum += weights[slot] * (s > 0 ? one + s * (table[far + part] + t * (table[far + 4 + part] - table[far + part]) - one) : one);
      }
      rows[row + 3 + part] = (light[4 * vertex + part] * sum) / scale;
    }
  }
}

/** The vertices as columns of numbers, four zones each, those with a weight first. */
function inColumns(vertices) {
  const columns = { places: new Float64Array(3 * vertices.length), light: new Float64Array(4 * vertices.length), zones: new Uint32Array(4 * vertices.length), weights: new Float64Array(4 * vertices.length) };
  vertices.forEach(({ place, light, zones }, vertex) => {
    columns.places.set(place, 3 * vertex);
    columns.light.set(light, 4 * vertex);
    zones.forEach(([zone, weight], slot) => {
      columns.zones[4 * vertex + slot] = zone;
      columns.weights[4 * vertex + slot] = weight;
    });
  });
  return columns;
}

/** Sums of the normals of each vertex's triangles by area, how many those are, and the area of all. */
function about(lamp, count) {
  const [sums, uses] = [new Float32Array(3 * count), new Uint16Array(count)];
  let all = 0;
  for (let triangle = 0; triangle < lamp.triangles; triangle += 1) {
    const { normal, area } = lamp.normal(triangle);
    all += area;
    for (let corner = 0; corner < 3; corner += 1) {
      const vertex = lamp.indices[3 * triangle + corner];
      uses[vertex] += 1;
      for (let axis = 0; axis < 3; axis += 1) sums[3 * vertex + axis] += area * normal[axis];
    }
  }
  return { sums, uses, area: all };
}

function mainZone(lamp, vertex) {
  const weights = lamp.zoneWeights.subarray(4 * vertex, 4 * vertex + 4);
  return lamp.zoneIds[4 * vertex + weights.indexOf(Math.max(...weights))];
}

/** One vertex that stands for several: `zones` are those of its place with their weights. */
function merged(lamp, vertices, uses) {
  const fewest = Math.min(...vertices.map((k) => uses[k]));
  const outer = vertices.filter((k) => uses[k] === fewest);
  const place = (k) => lamp.positions.subarray(3 * k, 3 * k + 3);
  const middle = [0, 1, 2].map((axis) => outer.reduce((sum, k) => sum + place(k)[axis], 0) / outer.length);
  const away = (k) => Math.hypot(...middle.map((value, axis) => value - place(k)[axis]));
  const chosen = outer.reduce((best, k) => (away(k) < away(best) ? k : best));
  const light = [0, 0, 0, 0];
  let area = 0;
  for (const k of vertices) {
    area += lamp.areas[k];
    for (let part = 0; part < 4; part += 1) light[part] += lamp.areas[k] * lamp.exitance[4 * k + part];
  }
  const zones = [0, 1, 2, 3].map((k) => [lamp.zoneIds[4 * chosen + k], lamp.zoneWeights[4 * chosen + k]]).filter(([, weight]) => weight > 0);
  return { place: [...place(chosen)], light: light.map((sum) => (area > 0 ? sum / area : 0)), zones };
}

/** Triangles between vertices that are still three, each once. */
function corners(indices, cellOf) {
  const [kept, seen] = [[], new Set()];
  for (let k = 0; k < indices.length; k += 3) {
    const three = [cellOf[indices[k]], cellOf[indices[k + 1]], cellOf[indices[k + 2]]];
    if (new Set(three).size < 3) continue;
    const key = [...three].sort((a, b) => a - b).join();
    if (seen.has(key)) continue;
    seen.add(key);
    kept.push(...three);
  }
  return Uint32Array.from(kept);
}
