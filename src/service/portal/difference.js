// The difference of two pictures of one camera and one scale, in per cent of the first one's peak.
import { h, put } from "./dom.js";
import { percent } from "./numbers.js";
import { words } from "./words.js";

/** Stations of the colours, sRGB: the second is darker, alike, brighter. */
const STATIONS = [[120, 205, 255], [38, 98, 190], [18, 21, 32], [190, 82, 20], [255, 205, 110]];
const GRADIENT = `linear-gradient(to right, ${STATIONS.map((rgb) => `rgb(${rgb.join(" ")})`).join(", ")})`;
/** This part of the lit pixels stays below what is called their peak: lone bright pixels at a rim do not count. */
const NEARLY_ALL = 0.995;
/** The scale ends no nearer to 0 than this. */
const LEAST_END = 0.01;

export class Difference {
  constructor(first, second) {
    Object.assign(this, { first, second, parts: null, size: [0, 0] });
    this.canvas = h("canvas", { class: "difference", role: "img", width: 2, height: 2, "aria-label": words.compare.difference, onpointermove: (event) => this.point(event), onpointerleave: () => this.first.placeCursor(null) });
    this.cross = h("div", { class: "cross", hidden: true });
    this.ramp = h("div", { class: "ramp" });
    this.ramp.style.background = GRADIENT;
    this.ticks = h("div", { class: "ticks" });
    this.value = h("output", { class: "reading" }, words.compare.point);
    this.told = h("p", { class: "hint", role: "status" });
    this.element = h("section", { class: "card", "aria-labelledby": "difference-title" },
      h("h2", { id: "difference-title" }, words.compare.difference),
      h("div", { class: "stage" }, this.canvas, this.cross),
      h("div", { class: "under" }, h("div", { class: "legend" }, this.ramp, this.ticks), this.value), this.told);
  }

  /** Points at the same place of all three. */
  point(event) {
    const box = this.canvas.getBoundingClientRect();
    this.first.placeCursor([(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height], true);
  }

  /** Finds it anew, of two pictures that rest. */
  update() {
    const [a, b] = [this.first, this.second];
    const { mode } = a;
    const isShown = mode === "seen" || mode === "true" || mode === "exitance";
    this.canvas.parentElement.hidden = this.ramp.parentElement.parentElement.hidden = !isShown;
    if (!isShown) return put(this.told, words.compare.noDifference);
    if (a.picture.size.join() !== b.picture.size.join() || !a.picture.size[0]) return null;
    const [one, two] = [a, b].map((view) => component(view.picture.read(0, 0, ...view.picture.size, mode), view.component()));
    const peak = nearly(one.filter((value) => value > 0)) || nearly(two.filter((value) => value > 0)) || 1;
    this.size = [...a.picture.size];
    this.parts = one.map((value, k) => (two[k] - value) / peak);
    const lit = this.parts.filter((_, k) => one[k] > 0 || two[k] > 0);
    this.rms = lit.length ? Math.sqrt(lit.reduce((sum, part) => sum + part * part, 0) / lit.length) : 0;
    this.end = rounded(Math.max(LEAST_END, nearly(lit.map(Math.abs))));
    this.paint();
    const { factor, unit } = a.quantity();
    put(this.told, words.compare.facts(percent(this.rms), words.compare.valueOf(peak * factor, unit)));
    return this.read(a.cursor);
  }

  paint() {
    const [width, height] = this.size;
    [this.canvas.width, this.canvas.height] = this.size;
    const image = new ImageData(width, height);
    for (let row = 0; row < height; row += 1) {
      for (let column = 0; column < width; column += 1) {
        // Sums begin at the bottom.
        const part = this.parts[(height - 1 - row) * width + column] / this.end;
        const at = (Math.min(1, Math.max(-1, part)) + 1) * 2;
        const low = Math.min(3, Math.floor(at));
        const place = 4 * (row * width + column);
        for (let axis = 0; axis < 3; axis += 1) image.data[place + axis] = STATIONS[low][axis] + (at - low) * (STATIONS[low + 1][axis] - STATIONS[low][axis]);
        image.data[place + 3] = 255;
      }
    }
    this.canvas.getContext("2d").putImageData(image, 0, 0);
    put(this.ticks, [-1, -0.5, 0, 0.5, 1].map((part) => h("span", {}, words.compare.percent(100 * part * this.end))));
  }

  /** What it is at a point, 0 to 1 from the left and the top. */
  read(at) {
    this.cross.hidden = !at;
    if (!at || !this.parts) {
      this.value.textContent = words.compare.point;
      return null;
    }
    [this.cross.style.left, this.cross.style.top] = at.map((part) => `${100 * part}%`);
    const [width, height] = this.size;
    const [column, row] = [Math.min(width - 1, Math.floor(at[0] * width)), Math.max(0, Math.ceil(height - at[1] * height) - 1)];
    const part = this.parts[row * width + column];
    this.value.textContent = words.compare.reading(100 * part);
    return part;
  }
}

function component(all, k) {
  const out = new Float32Array(all.length / 4);
  for (let place = 0; place < out.length; place += 1) out[place] = all[4 * place + k];
  return out;
}

function nearly(values) {
  return values.length ? values.sort()[Math.floor(NEARLY_ALL * (values.length - 1))] : 0;
}

function rounded(value) {
  const step = 10 ** Math.floor(Math.log10(value));
  return Math.ceil(value / step - 1e-6) * step;
}
