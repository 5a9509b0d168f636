// The surface of a lamp with fewer triangles, for pictures that move where drawing all of them takes too long: vertices that lie near each
// other become one. What these few send towards the eye is found here: without a graphics card, a shader takes longer.

/** Cells of the lattice along each axis: three of these numbers, a zone and a side are one whole number. */
const MOST_CELLS = 2048;

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
 * Vertices `{ place, light, zones }` and the order in which they make about `most` triangles. In each cell of a lattice
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
  return found;
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

/** Puts the vertices as they are drawn into `rows`: what they send towards the eye, in units of `scale`. */
export function send(lamp, vertices, eye, scale, rows) {
  const { directions, q } = lamp;
  const gammas = directions.gamma.length;
  vertices.forEach(({ place, light, zones }, index) => {
    const { c, gamma } = directions.angles([eye[0] - place[0], eye[1] - place[1], eye[2] - place[2]]);
    const sums = [0, 0, 0, 0];
    for (const [j, k, share] of directions.nodes(c, gamma)) {
      if (!(share > 0)) continue;
      const at = 4 * (j * gammas + k);
      for (const [zone, weight] of zones) for (let part = 0; part < 4; part += 1) sums[part] += share * weight * q[zone][at + part];
    }
    rows.set(place, DRAWN * index);
    for (let part = 0; part < 4; part += 1) rows[DRAWN * index + 3 + part] = (light[part] * sums[part]) / scale;
  });
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
