// A plane before the lamp: where it is, what is asked of the service, and what its answer says at a place.
import { axisName } from "./axes.js";
import { falseColours, screen } from "./colour.js";
import { intensities } from "./facts.js";
import { halfWidth, section } from "./goniogram.js";

/** Steps of the slider, and what they span: from the first to the last in longest edges of the source. */
export const STEPS = 200;
const [NEAREST, FARTHEST] = [0.05, 200];
const FIRST_SIZES = 2;
/** A plane is so wide that light within these angles to each side of its middle meets it, degrees. */
const [NARROWEST_DEG, WIDEST_DEG] = [4, 50];
/** Points along each side and error of the answers that are asked for: the first comes soon, and a finer one takes its place. */
export const LEVELS = [{ points: 24, tolerance: 0.05 }, { points: 64, tolerance: 0.02 }, { points: 128, tolerance: 0.005 }];
/** Numbers that the service computes at once, cells times bands; colours are found of all bands. */
const MOST_NUMBERS = 262_144;

const dot = (a, b) => a.reduce((sum, value, k) => sum + value * b[k], 0);

export class Plane {
  constructor(lamp) {
    this.lamp = lamp;
    const { min, max } = lamp.box;
    this.middle = min.map((low, k) => (low + max[k]) / 2);
    this.size = Math.max(...min.map((low, k) => max[k] - low)) || 1;
    this.sides = [[0, 0], [180, 0], [90, 0], [90, 90], [90, 180], [90, 270]].map(([gamma, c]) => {
      const vector = lamp.directions.vector(c, gamma).map((value) => Number(value.toFixed(12)) || 0);
      return { gamma, c, vector, axis: axisName(vector) };
    });
    Object.assign(this, { side: 0, width: null, light: lamp.isLuminous ? "luminous" : "radiant" });
    this.distance = rounded(FIRST_SIZES * this.size);
  }

  get sizes() {
    return this.distance / this.size;
  }

  get step() {
    return Math.round(STEPS * Math.log(this.sizes / NEAREST) / Math.log(FARTHEST / NEAREST));
  }

  set step(step) {
    this.distance = rounded(this.size * NEAREST * (FARTHEST / NEAREST) ** (step / STEPS));
  }

  /** Where the light ends in the direction of the plane, mm from its middle. */
  front() {
    const { vector } = this.sides[this.side];
    const points = this.lamp.volume?.points ?? this.lamp.positions;
    let most = -Infinity;
    for (let k = 0; k < points.length; k += 3) most = Math.max(most, dot(vector, [points[k], points[k + 1], points[k + 2]]));
    return most - dot(vector, this.middle);
  }

  /** Width of the plane, mm: what was said, or what the beam needs. */
  wide() {
    return this.width ?? rounded(this.size + 2 * this.distance * Math.tan((this.angle() * Math.PI) / 180));
  }

  /** Degrees from the middle of the plane to its edge, seen from far away: the whole width of the beam at half of its peak. */
  angle() {
    if (this.side !== 0) return WIDEST_DEG;
    const { grid } = intensities(this.lamp, this.lamp.goniograms.total);
    const widths = [0, 90].map((c) => halfWidth(section(grid, this.lamp.directions, c)) ?? 2 * WIDEST_DEG);
    return Math.min(WIDEST_DEG, Math.max(NARROWEST_DEG, ...widths));
  }

  question({ points: wanted, tolerance }) {
    const bands = this.light !== "color" ? 1 : (this.lamp.spectrum?.band_edges_nm.length ?? 6) - 1;
    const points = Math.min(wanted, Math.floor(Math.sqrt(MOST_NUMBERS / bands)));
    const { vector } = this.sides[this.side];
    const far = this.front() + this.distance;
    const plain = (list) => list.map((value) => Number(value.toPrecision(9)) || 0);
    const plane = {
      center_mm: plain(this.middle.map((value, k) => value + far * vector[k])), normal: plain(vector.map((value) => -value)),
      width_mm: this.wide(), height_mm: this.wide(), columns: points, rows: points,
    };
    return { view: { plane }, light: this.light, tolerance };
  }
}

/** Three significant digits: what a slider says is what is asked. */
function rounded(value) {
  return Number(value.toPrecision(3));
}

/** An answer as places with values. */
export class Lit {
  constructor(answer) {
    const { columns, rows, channels, light, view: { plane } } = answer;
    Object.assign(this, { columns, rows, light, plane });
    const main = channels[light === "color" ? 1 : 0];
    Object.assign(this, { main, unit: main.unit, channels, most: main.largest });
    const all = main.values.flat();
    this.mean = all.reduce((sum, value) => sum + value, 0) / all.length;
    this.least = all.reduce((least, value) => Math.min(least, value), Infinity);
    const at = all.indexOf(all.reduce((most, value) => Math.max(most, value), -Infinity));
    this.brightest = [((at % columns) + 0.5) / columns, (Math.floor(at / columns) + 0.5) / rows];
  }

  /** mm² of a cell. */
  get cellArea() {
    return Math.hypot(...this.plane.column_step_mm) * Math.hypot(...this.plane.row_step_mm);
  }

  /** lm or W that meet the plane. */
  get flux() {
    return this.mean * this.columns * this.rows * this.cellArea * 1e-6;
  }

  /** Which way the picture's right and up are. */
  get directions() {
    const unit = (vector, sign) => vector.map((value) => (sign * value) / Math.hypot(...vector));
    return { right: axisName(unit(this.plane.column_step_mm, 1)), up: axisName(unit(this.plane.row_step_mm, -1)) };
  }

  cell([u, v]) {
    return [Math.min(this.columns - 1, Math.floor(u * this.columns)), Math.min(this.rows - 1, Math.floor(v * this.rows))];
  }

  /** Value, bound, place in mm, and colour, at a part of the width and of the height from the left and the top. */
  at(place) {
    const [column, row] = this.cell(place);
    const { first_mm: first, column_step_mm: right, row_step_mm: down } = this.plane;
    const of = (k) => this.channels[k].values[row][column];
    return {
      value: this.main.values[row][column], bound: this.main.bounds[row][column],
      point: first.map((value, k) => value + column * right[k] + row * down[k]),
      xy: this.light === "color" ? [of(3), of(4)] : null,
    };
  }

  /** Offsets from the middle, mm, and values: along the row, or up the column, through a place. */
  profile(place, isRow) {
    const [column, row] = this.cell(place);
    const step = Math.hypot(...(isRow ? this.plane.column_step_mm : this.plane.row_step_mm));
    const values = isRow ? this.main.values[row] : this.main.values.map((line) => line[column]).reverse();
    return values.map((value, k) => [(k - (values.length - 1) / 2) * step, value]);
  }

  /** Pixels of the picture: false colours of the values, or true colours, up to `greatest`. */
  pixels(greatest, decades) {
    const out = new Uint8ClampedArray(4 * this.columns * this.rows);
    const colours = falseColours();
    for (let row = 0, at = 0; row < this.rows; row += 1) {
      for (let column = 0; column < this.columns; column += 1, at += 4) {
        if (this.light === "color") {
          const xyz = [0, 1, 2].map((k) => this.channels[k].values[row][column] / greatest);
          out.set([...screen(xyz), 255], at);
          continue;
        }
        const part = this.main.values[row][column] / greatest;
        const where = decades ? 1 + Math.log10(Math.max(part, 1e-12)) / decades : part;
        const shade = 4 * Math.round(255 * Math.min(1, Math.max(0, where)));
        out.set(colours.subarray(shade, shade + 4), at);
      }
    }
    return new ImageData(out, this.columns, this.rows);
  }
}
