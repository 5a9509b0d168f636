// The picture with its controls: turning, zooming, what is shown, the scale, and the value under the pointer.
import { announce, button, field, h, put, select } from "./dom.js";
import { GRADIENT } from "./colour.js";
import { Camera } from "./camera.js";
import { Picture } from "./picture.js";
import { coordinate, measured, prefixed, quantity, significant } from "./numbers.js";
import { words } from "./words.js";

const TURN_DEG = 5;
/** While it moves, a picture that takes longer than this is drawn with fewer pixels. */
const SLOW_MS = 45;
const REST_MS = 220;

/** The picture of a lamp; `onzone(id)` is told which zone is under the pointer, null for none. */
export class View {
  constructor(lamp, onzone) {
    this.lamp = lamp;
    this.onzone = onzone;
    this.canvas = h("canvas", { class: "lamp", tabindex: 0, role: "img", "aria-label": words.view.canvas });
    this.picture = new Picture(this.canvas, lamp);
    this.camera = new Camera(lamp.directions, lamp.box);
    Object.assign(this, { mode: "seen", decades: 0, held: false, greatest: null, coarse: 1, cursor: null, zone: null });
    this.element = this.build();
    this.listen();
    new ResizeObserver(() => this.request()).observe(this.canvas);
  }

  build() {
    const modes = ["seen", this.lamp.hasColour ? "true" : null, "exitance", "zones", "stages"].filter(Boolean);
    this.modes = select(modes.map((mode) => [mode, words.view.modes[mode]]), this.mode, (mode) => this.become({ mode }));
    this.range = select(words.view.ranges, "0", (decades) => this.become({ decades: Number(decades) }));
    this.hold = h("input", { type: "checkbox", onchange: (event) => this.become({ held: event.target.checked }) });
    this.value = h("output", { class: "reading", id: "reading" }, words.view.point);
    this.whence = h("p", { class: "whence" });
    this.ramp = h("div", { class: "ramp" });
    this.ramp.style.background = GRADIENT;
    this.ticks = h("div", { class: "ticks" });
    this.legend = h("div", { class: "legend", role: "img", "aria-label": "" }, this.ramp, this.ticks);
    this.cross = h("div", { class: "cross", hidden: true });
    const move = (text, label, action) => h("button", { type: "button", "aria-label": label, title: label, onclick: () => { action(); this.moved(); } }, text);
    return h("section", { class: "view", "aria-label": words.view.title },
      h("div", { class: "stage" }, this.canvas, this.cross, this.whence,
        h("div", { class: "moves" },
          move("◀", words.view.left, () => this.camera.turn(-15, 0)), move("▶", words.view.right, () => this.camera.turn(15, 0)),
          move("▲", words.view.up, () => this.camera.turn(0, -10)), move("▼", words.view.down, () => this.camera.turn(0, 10)),
          move("+", words.view.nearer, () => this.camera.zoom(0.8)), move("−", words.view.farther, () => this.camera.zoom(1.25)),
          button(words.view.fit, () => { this.camera.home(); this.moved(); }))),
      h("div", { class: "under" }, this.legend, this.value),
      h("div", { class: "row controls" },
        field(words.view.mode, this.modes), field(words.view.range, this.range),
        h("label", { class: "check" }, this.hold, words.view.hold)),
      h("p", { class: "hint", id: "view-help" }, words.view.help));
  }

  become(change) {
    Object.assign(this, change);
    if ("mode" in change) this.greatest = null;
    this.request();
  }

  moved() {
    this.moving = performance.now();
    this.request();
  }

  /** One drawing for any number of changes. */
  request() {
    this.pending ??= requestAnimationFrame(() => {
      this.pending = null;
      if (this.canvas.isConnected) this.render();
    });
  }

  render() {
    const began = performance.now();
    const rests = began - (this.moving ?? 0) > REST_MS;
    const { clientWidth, clientHeight } = this.canvas;
    if (!clientWidth || !clientHeight) return;
    const fine = Math.min(devicePixelRatio || 1, 2) / (rests ? 1 : this.coarse);
    this.picture.resize(Math.max(1, Math.round(clientWidth * fine)), Math.max(1, Math.round(clientHeight * fine)));
    this.picture.sum(this.camera, this.mode, !rests);
    if (!this.greatest || (rests && !this.held)) this.greatest = this.brightest() ?? this.greatest ?? 1;
    const unit = this.picture.unit(this.mode);
    this.picture.draw(this.mode, { greatest: this.greatest / unit, decades: this.decades });
    this.caption();
    if (rests) {
      this.readAtCursor();
      return;
    }
    this.picture.gl.finish();
    const took = performance.now() - began;
    if (took > SLOW_MS && this.coarse < 4) this.coarse *= 1.5;
    clearTimeout(this.settle);
    this.settle = setTimeout(() => this.request(), REST_MS + 10);
  }

  component() {
    return this.lamp.isLuminous ? 1 : 3;
  }

  /** What nearly all lit pixels are below, in a round number: lone bright pixels at a rim do not darken the rest. */
  brightest() {
    const all = this.picture.read(0, 0, ...this.picture.size, this.mode);
    const lit = [];
    for (let k = this.component(); k < all.length; k += 4) if (all[k] > 0) lit.push(all[k]);
    if (!lit.length) return null;
    const sorted = Float32Array.from(lit).sort();
    const high = sorted[Math.floor(0.995 * (sorted.length - 1))];
    const step = 10 ** Math.floor(Math.log10(high)) / 2;
    return Math.ceil(high / step) * step;
  }

  caption() {
    const { c, gamma, distance } = this.camera;
    this.whence.textContent = words.view.whence(Math.round(c), Math.round(gamma), significant(distance, 3));
    const isScaled = this.mode === "seen" || this.mode === "exitance";
    this.legend.hidden = !isScaled;
    this.range.disabled = !isScaled;
    if (!isScaled) return;
    const { factor, unit } = quantity(this.mode, this.lamp.isLuminous);
    const most = this.greatest * factor;
    const shown = prefixed(most, unit);
    const at = (where) => most * shown.factor * (this.decades ? 10 ** (this.decades * (where - 1)) : where);
    put(this.ticks, [0, 0.25, 0.5, 0.75, 1].map((where) => h("span", {}, significant(at(where), 3), where === 1 ? ` ${shown.unit}` : "")));
    this.legend.setAttribute("aria-label", words.view.scale(measured(most, unit)));
  }

  listen() {
    const { canvas } = this;
    const pointers = new Map();
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      pointers.set(event.pointerId, [event.clientX, event.clientY]);
    });
    canvas.addEventListener("pointermove", (event) => {
      const before = pointers.get(event.pointerId);
      if (!before) return this.point(event);
      const [dx, dy] = [event.clientX - before[0], event.clientY - before[1]];
      const others = [...pointers].filter(([id]) => id !== event.pointerId);
      pointers.set(event.pointerId, [event.clientX, event.clientY]);
      if (others.length) this.pinch(before, [event.clientX, event.clientY], others[0][1], dx, dy);
      else if (event.shiftKey || event.buttons === 4) this.shift(-dx, dy);
      else this.camera.turn(-dx * 0.4, -dy * 0.4);
      return this.moved();
    });
    for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, (event) => pointers.delete(event.pointerId));
    canvas.addEventListener("pointerleave", () => { if (!pointers.size) this.placeCursor(null); });
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.camera.zoom(Math.exp(event.deltaY * 0.0012));
      this.moved();
    }, { passive: false });
    canvas.addEventListener("keydown", (event) => this.key(event));
    canvas.setAttribute("aria-describedby", "view-help reading");
  }

  pinch(before, now, other, dx, dy) {
    const apart = ([x, y]) => Math.hypot(x - other[0], y - other[1]);
    this.camera.zoom(apart(before) / Math.max(apart(now), 1));
    this.shift(-dx / 2, dy / 2);
  }

  /** Moves what is looked at, by pixels of the page. */
  shift(right, up) {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    this.camera.shift(right / height, up / height, width / height);
  }

  key(event) {
    const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    if (way && event.altKey) {
      this.camera.shift(0.05 * way[0], -0.05 * way[1], this.canvas.clientWidth / this.canvas.clientHeight);
      this.moved();
    } else if (way && event.shiftKey) {
      const [x, y] = this.cursor ?? [0.5, 0.5];
      const inside = (value) => Math.min(0.999, Math.max(0, value));
      this.placeCursor([inside(x + 0.02 * way[0]), inside(y + 0.02 * way[1])], true);
    } else if (way) {
      this.camera.turn(TURN_DEG * way[0], TURN_DEG * way[1]);
      this.moved();
    } else if (event.key === "+" || event.key === "=") {
      this.camera.zoom(0.87);
      this.moved();
    } else if (event.key === "-") {
      this.camera.zoom(1.15);
      this.moved();
    } else if (event.key === "0" || event.key === "Home") {
      this.camera.home();
      this.moved();
    } else if (event.key === "Enter") {
      this.placeCursor(this.cursor ?? [0.5, 0.5], true);
      announce(`${this.value.textContent} ${this.whence.textContent}`);
    } else return;
    event.preventDefault();
  }

  point(event) {
    const box = this.canvas.getBoundingClientRect();
    const at = [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
    this.latest = at;
    // Pointers tell of more moves than there are pictures.
    this.reading ??= requestAnimationFrame(() => {
      this.reading = null;
      this.placeCursor(this.latest, false);
    });
  }

  placeCursor(at, isMarked = false) {
    this.cursor = at;
    this.cross.hidden = !(at && isMarked);
    if (at && isMarked) {
      this.cross.style.left = `${100 * at[0]}%`;
      this.cross.style.top = `${100 * at[1]}%`;
    }
    this.readAtCursor();
  }

  /** The value, the place and the zone at the cursor. */
  readAtCursor() {
    const found = this.cursor ? this.valueAt(...this.cursor) : null;
    this.value.textContent = found ? found.text : words.view.point;
    if (this.zone !== (found?.zone ?? null)) {
      this.zone = found?.zone ?? null;
      this.onzone(this.zone);
    }
  }

  /** What is seen at a point of the picture, 0 to 1 from its left and top. */
  valueAt(x, y) {
    const [width, height] = this.picture.size;
    const pixel = [Math.min(width - 1, Math.floor(x * width)), Math.max(0, Math.ceil(height - y * height) - 1)];
    const aspect = width / height;
    const { eye, way } = this.camera.line(2 * x - 1, 1 - 2 * y, aspect);
    const met = this.lamp.volume && (this.mode === "seen" || this.mode === "true") ? null : this.lamp.meet(eye, way);
    const shownMode = this.mode === "zones" || this.mode === "stages" ? null : this.mode;
    const read = shownMode ? this.picture.read(...pixel, 1, 1, this.mode) : null;
    const value = read ? read[this.component()] : null;
    const zone = met ? this.lamp.zoneAt(met) : null;
    const { factor, unit } = quantity(this.mode === "exitance" ? "exitance" : "seen", this.lamp.isLuminous);
    const text = words.view.reading({
      value: value === null ? null : measured(value * factor, unit),
      isDark: value === 0, zone, point: met ? met.point.map((value) => coordinate(value, 2 * this.camera.radius)) : null,
      stage: this.mode === "stages" && met ? this.lamp.stages.labels[this.lamp.stages.values[met.triangle]] : null,
    });
    return { text, value: value === null ? null : value * factor, unit, zone, point: met?.point ?? null };
  }
}
