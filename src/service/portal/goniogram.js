// Where the light goes, by openapi/README.md, sections 1 and 3: the photometric frame, intensities between nodes, and q.
const RAD = Math.PI / 180;

/** The photometric frame and the nodes, which all zones share. */
export class Directions {
  constructor(goniograms, entry) {
    const { axes_in_source: axes } = goniograms.frame;
    Object.assign(this, { x: axes.x, y: axes.y, z: axes.z, c: entry.c_deg, gamma: entry.gamma_deg, weights: entry.interpolation_weight_sr });
  }

  /** Unit vector of travel, source frame. */
  vector(cDeg, gammaDeg) {
    const [sinG, cosG, sinC, cosC] = [Math.sin(gammaDeg * RAD), Math.cos(gammaDeg * RAD), Math.sin(cDeg * RAD), Math.cos(cDeg * RAD)];
    return [0, 1, 2].map((k) => sinG * cosC * this.x[k] + sinG * sinC * this.y[k] - cosG * this.z[k]);
  }

  /** C and γ of a vector of the source frame, degrees. */
  angles(vector) {
    const [x, y, z] = [this.x, this.y, this.z].map((axis) => axis.reduce((sum, value, k) => sum + value * vector[k], 0));
    return { c: ((Math.atan2(y, x) / RAD) + 360) % 360, gamma: Math.atan2(Math.hypot(x, y), -z) / RAD };
  }

  /** Weights of the (at most) four nodes about a direction: `[c, gamma, weight]`. */
  nodes(cDeg, gammaDeg) {
    const count = this.c.length;
    const turn = ((cDeg % 360) + 360) % 360 / (360 / count);
    const [j, s] = [Math.floor(turn) % count, count === 1 ? 0 : turn - Math.floor(turn)];
    let k = 0;
    while (k < this.gamma.length - 2 && gammaDeg >= this.gamma[k + 1]) k += 1;
    const t = (gammaDeg - this.gamma[k]) / (this.gamma[k + 1] - this.gamma[k]);
    const next = (j + 1) % count;
    return [[j, k, (1 - s) * (1 - t)], [j, k + 1, (1 - s) * t], [next, k, s * (1 - t)], [next, k + 1, s * t]];
  }

  /** Integral over the sphere of what is bilinear between `value(c, gamma)` at the nodes: N of section 3. */
  integral(value) {
    let sum = 0;
    for (let j = 0; j < this.c.length; j += 1) {
      for (let k = 0; k < this.gamma.length; k += 1) sum += this.weights[k] * value(j, k);
    }
    return sum;
  }
}

/** q of a zone at every node, C first, 1/sr: `[X, Y, Z, radiant]` in turn. A zone without light gets the q of `instead`. */
export function normalised(entry, directions, spectrum, weigh, instead) {
  const own = (grid) => {
    if (!grid) return null;
    const sum = directions.integral((j, k) => grid[j][k]);
    return sum > 0 ? (j, k) => grid[j][k] / sum : null;
  };
  const radiant = own(entry.radiant_intensity_W_per_sr);
  const luminous = own(entry.luminous_intensity_cd);
  const any = luminous ?? radiant;
  const [x, , z] = coloured(entry, directions, spectrum, weigh) ?? [];
  const out = new Float32Array(4 * directions.c.length * directions.gamma.length);
  if (!any) return instead ?? out;
  let at = 0;
  for (let j = 0; j < directions.c.length; j += 1) {
    for (let k = 0; k < directions.gamma.length; k += 1) {
      const y = any(j, k);
      out.set([x ? x(j, k) : y, y, z ? z(j, k) : y, (radiant ?? any)(j, k)], at);
      at += 4;
    }
  }
  return out;
}

/** q of X, Y and Z, from the intensities by band; null where the light has one spectrum in all directions. */
function coloured(entry, directions, spectrum, weigh) {
  const dense = entry.spectral_intensity;
  if (!dense || !spectrum) return null;
  const [, gammas, bands] = dense.shape;
  const grid = new Directions({ frame: { axes_in_source: directions } }, dense.grid);
  const node = (j, k) => weigh(dense.values.slice((j * gammas + k) * bands, (j * gammas + k + 1) * bands));
  const sums = [0, 0, 0];
  const values = grid.c.map((_, j) => grid.gamma.map((__, k) => {
    const xyz = node(j, k);
    xyz.forEach((value, axis) => { sums[axis] += grid.weights[k] * value; });
    return xyz;
  }));
  const at = (axis) => (j, k) => grid.nodes(directions.c[j], directions.gamma[k])
    .reduce((sum, [c, gamma, weight]) => sum + weight * values[c][gamma][axis], 0) / sums[axis];
  return sums.map((sum, axis) => (sum > 0 ? at(axis) : null));
}

/**
 * X, Y, Z of the light in the directions of the nodes, lm/sr, `[c][gamma]`: of the whole source where its own spectra by direction are
 * known, else of its zones together; null where no spectra are.
 */
export function tristimulusGrid({ total, zones }, directions, spectrum, weigh) {
  if (!spectrum || !total.spectral_flux_W_per_nm) return null;
  const entries = total.spectral_intensity ? [total] : zones.filter((zone) => zone.spectral_flux_W_per_nm);
  const out = directions.c.map(() => directions.gamma.map(() => [0, 0, 0]));
  for (const entry of entries) {
    const grid = entry.luminous_intensity_cd ?? entry.radiant_intensity_W_per_sr;
    const sum = grid ? directions.integral((j, k) => grid[j][k]) : 0;
    if (!(sum > 0)) continue;
    const flux = weigh(entry.spectral_flux_W_per_nm);
    const own = coloured(entry, directions, spectrum, weigh) ?? [];
    const alike = (j, k) => grid[j][k] / sum;
    out.forEach((row, j) => row.forEach((xyz, k) => flux.forEach((value, axis) => { xyz[axis] += value * (own[axis] ?? alike)(j, k); })));
  }
  return out;
}

/**
 * A half-plane pair: intensities from γ = 0 out to `cDeg` and to the other side, `[signed γ, intensity]` in order; between C planes,
 * bilinear as everywhere.
 */
export function section(grid, directions, cDeg) {
  const side = (c) => directions.gamma.map((gamma) => [gamma, directions.nodes(c, gamma).reduce((sum, [j, k, weight]) => sum + weight * grid[j][k], 0)]);
  const back = side(cDeg + 180).slice(1).reverse().map(([gamma, value]) => [-gamma, value]);
  return [...back, ...side(cDeg)];
}

/** Full width at half of the greatest value of a section, degrees; null where one side never falls below. */
export function halfWidth(points) {
  const peak = points.reduce((best, [, value], k) => (value > points[best][1] ? k : best), 0);
  const half = points[peak][1] / 2;
  const edge = (step) => {
    for (let k = peak; points[k + step]; k += step) {
      const [[a, high], [b, low]] = [points[k], points[k + step]];
      if (low <= half) return a + ((b - a) * (high - half)) / (high - low || 1);
    }
    return null;
  };
  const [left, right] = [edge(-1), edge(1)];
  return left === null || right === null ? null : right - left;
}
