// The picture with its controls: turning, zooming, what is shown, the scale, cuts, and the value under the pointer. Several pictures may
// be linked: they have one camera, one scale and one pointer.
import { announce, button, field, h, put, select } from "./dom.js";
import { Axes } from "./axes.js";
import { GRADIENT } from "./colour.js";
import { Camera } from "./camera.js";
import { cutControls, planes, uncut } from "./cut.js";
import { intensities } from "./facts.js";
import { meets } from "./lamp.js";
import { Picture } from "./picture.js";
import { ceiling, coordinate, measured, prefixed, quantity, significant } from "./numbers.js";
import { intensityAt, peakOf } from "./solid.js";
import { words } from "./words.js";

const TURN_DEG = 5;
/**
 * While it moves, a picture that takes longer than this is drawn with few triangles, then with half as many pixels; one that takes less than
 * that with twice as many. Without a graphics card a browser takes as long again to put it on the screen: 30 pictures a second are left.
 */
const SLOW_MS = 16;
const FAST_MS = 6;
/**
 * After a slow picture few triangles are drawn for so long; then all of them are tried again, as the machine may have been busy with something
 * else. Where they are slow again, the next time is twice as long.
 */
const FEW_FOR_MS = 4000;
const LONGEST_FEW_MS = 256000;
/** Fewest pixels: each is so many times as wide as at rest. */
const COARSEST = 4;
const REST_MS = 220;
/** So often its caption follows a picture that moves: changing the page takes as long as drawing the lamp. */
const CAPTION_MS = 100;

/** The picture of a lamp; `onzone(id)` is told which zone is under the pointer, null for none. */
export class View {
  /** `camera`: one of several pictures; `modes`: what may be shown; `label`: what it is called. */
  constructor(lamp, onzone, { camera = new Camera(lamp.directions, lamp.box), modes = null, label = words.view.title } = {}) {
    this.lamp = lamp;
    this.onzone = onzone;
    this.label = label;
    this.canvas = h("canvas", { class: "lamp", tabindex: 0, role: "img", "aria-label": `${label}. ${words.view.canvas}` });
    this.picture = new Picture(this.canvas, lamp);
    this.camera = camera;
    this.links = [this];
    const all = ["seen", lamp.hasColour ? "true" : null, "exitance", "solid", "zones", "stages"];
    this.offered = all.filter((mode) => mode && (!modes || modes.includes(mode)));
    Object.assign(this, { mode: "seen", decades: 0, held: false, greatest: null, own: null, coarse: 1, cursor: null, zone: null });
    Object.assign(this, { fewUntil: 0, fewFor: FEW_FOR_MS });
    this.cuts = uncut();
    this.build();
    this.listen();
    new ResizeObserver(() => this.request()).observe(this.canvas);
  }

  /** Makes `stage`, `legend`, `value` and `controls`. */
  build() {
    this.value = h("output", { class: "reading" }, words.view.point);
    this.whence = h("p", { class: "whence" }, "…");
    this.ramp = h("div", { class: "ramp" });
    this.ramp.style.background = GRADIENT;
    this.ticks = h("div", { class: "ticks" });
    this.legend = h("div", { class: "legend", role: "img", hidden: true }, this.ramp, this.ticks);
    this.cross = h("div", { class: "cross", hidden: true });
    this.axes = new Axes(this.lamp.directions);
    const move = (text, label, action) => h("button", { type: "button", "aria-label": label, title: label, onclick: () => { action(); this.moved(); } }, text);
    this.moves = h("div", { class: "moves" },
      move("◀", words.view.left, () => this.camera.turn(-15, 0)), move("▶", words.view.right, () => this.camera.turn(15, 0)),
      move("▲", words.view.up, () => this.camera.turn(0, -10)), move("▼", words.view.down, () => this.camera.turn(0, 10)),
      move("+", words.view.nearer, () => this.camera.zoom(0.8)), move("−", words.view.farther, () => this.camera.zoom(1.25)),
      button(words.view.fit, () => { this.camera.home(); this.moved(); }));
    this.stage = h("div", { class: "stage" }, this.canvas, this.cross, this.whence, this.axes.element, this.moves);
    this.range = select(words.view.ranges, "0", (decades) => this.become({ decades: Number(decades) }));
    this.cutting = cutControls(this);
    this.controls = h("div", { class: "row controls" },
      field(words.view.mode, select(this.offered.map((mode) => [mode, words.view.modes[mode]]), this.mode, (mode) => this.become({ mode }))),
      field(words.view.range, this.range),
      h("label", { class: "check" }, h("input", { type: "checkbox", onchange: (event) => this.become({ held: event.target.checked }) }), words.view.hold),
      this.cutting.element);
  }

  /** All of it as one part of a page. */
  get element() {
    this.value.id = "reading";
    this.canvas.setAttribute("aria-describedby", "view-help reading");
    return h("section", { class: "view", "aria-label": this.label }, this.stage,
      h("div", { class: "under" }, this.legend, this.value), this.controls,
      h("p", { class: "hint" }, this.axes.text),
      h("p", { class: "hint", id: "view-help" }, words.view.help));
  }

  /** The planes beyond which nothing is shown. */
  cutPlanes() {
    return planes(this.cuts, this.camera, this.mode === "solid");
  }

  become(change) {
    for (const view of this.links) {
      Object.assign(view, change);
      if ("mode" in change) view.greatest = view.own = null;
      view.request();
    }
    if ("mode" in change) this.cutting.tell();
  }

  moved() {
    for (const view of this.links) {
      view.moving = performance.now();
      view.request();
    }
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
    this.picture.isSlow = began < this.fewUntil;
    this.picture.sum(this.camera, this.mode, !rests, this.cutPlanes());
    this.scale(rests);
    this.paint();
    if (rests) {
      this.readAtCursor();
      this.onrest?.();
      return;
    }
    // Without this, pictures would be asked for faster than they are drawn, and those on the screen would be old.
    this.picture.finish();
    this.pace(performance.now() - began);
    clearTimeout(this.settle);
    this.settle = setTimeout(() => this.request(), REST_MS + 10);
  }

  /** Fewer triangles, then fewer pixels, where a picture that moves took so long; more where it was quick. */
  pace(took) {
    if (took > SLOW_MS && !this.picture.isSlow) {
      this.fewUntil = performance.now() + this.fewFor;
      this.fewFor = Math.min(2 * this.fewFor, LONGEST_FEW_MS);
    } else if (took > SLOW_MS) this.coarse = Math.min(COARSEST, this.coarse * Math.SQRT2);
    else if (took < FAST_MS && this.coarse > 1) this.coarse = Math.max(1, this.coarse / Math.SQRT2);
    else if (took < FAST_MS && !this.picture.isSlow) this.fewFor = FEW_FOR_MS;
  }

  /** What is brightest on the scale: of all linked pictures, once they rest. */
  scale(rests) {
    if (this.mode === "solid") {
      this.greatest = this.lamp.solidPeak ?? peakOf(this.lamp);
      return;
    }
    if (this.greatest && (!rests || this.held)) return;
    this.own = this.brightest() ?? this.own;
    const greatest = Math.max(...this.links.map(({ own }) => own ?? 0)) || this.greatest || 1;
    for (const view of this.links) {
      const isOld = view !== this && view.greatest && view.greatest !== greatest;
      view.greatest = greatest;
      if (isOld && view.picture.size[0]) view.paint();
    }
  }

  /** Shows what was summed. */
  paint() {
    this.picture.draw(this.mode, { greatest: this.greatest / this.picture.unit(this.mode), decades: this.decades });
    const now = performance.now();
    if (now - (this.moving ?? 0) < REST_MS && now - (this.captionedAt ?? 0) < CAPTION_MS) return;
    this.captionedAt = now;
    this.caption();
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
    return ceiling(sorted[Math.floor(0.995 * (sorted.length - 1))]);
  }

  /** From where it is seen, and the scale. Changes of a page cost more than the picture: only what differs is changed. */
  caption() {
    const { c, gamma, distance } = this.camera;
    this.whence.firstChild.data = words.view.whence(Math.round(c), Math.round(gamma), significant(distance, 3));
    this.axes.show(this.camera.axes());
    const now = [this.mode, this.decades, this.greatest].join();
    if (this.captioned === now) return;
    this.captioned = now;
    const isScaled = ["seen", "exitance", "solid"].includes(this.mode);
    this.legend.hidden = !isScaled;
    this.range.disabled = !isScaled || this.mode === "solid";
    if (!isScaled) return;
    const { factor, unit } = this.quantity();
    const most = this.greatest * factor;
    const shown = prefixed(most, unit);
    const decades = this.mode === "solid" ? 0 : this.decades;
    const at = (where) => most * shown.factor * (decades ? 10 ** (decades * (where - 1)) : where);
    put(this.ticks, [0, 0.25, 0.5, 0.75, 1].map((where) => h("span", {}, significant(at(where), 3), where === 1 ? ` ${shown.unit}` : "")));
    this.legend.setAttribute("aria-label", words.view.scale(measured(most, unit)));
  }

  /** What the values of the picture are, and how many of them one of the sum's is. */
  quantity() {
    if (this.mode === "solid") return { factor: 1, unit: intensities(this.lamp, this.lamp.goniograms.total).unit };
    return quantity(this.mode === "exitance" ? "exitance" : "seen", this.lamp.isLuminous);
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
    canvas.setAttribute("aria-describedby", "view-help");
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
    for (const view of this.links) {
      view.cursor = at;
      view.cross.hidden = !(at && (isMarked || view !== this));
      if (at) {
        view.cross.style.left = `${100 * at[0]}%`;
        view.cross.style.top = `${100 * at[1]}%`;
      }
      view.readAtCursor();
    }
    this.onpoint?.(at);
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
    if (!width) return null;
    const pixel = [Math.min(width - 1, Math.floor(x * width)), Math.max(0, Math.ceil(height - y * height) - 1)];
    const { eye, way } = this.camera.line(2 * x - 1, 1 - 2 * y, width / height);
    if (this.mode === "solid") return this.intensityOn(eye, way);
    const met = this.lamp.volume && (this.mode === "seen" || this.mode === "true") ? null : this.lamp.meet(eye, way, this.cutPlanes());
    const shownMode = this.mode === "zones" || this.mode === "stages" ? null : this.mode;
    const read = shownMode ? this.picture.read(...pixel, 1, 1, this.mode) : null;
    const value = read ? read[this.component()] : null;
    const zone = met ? this.lamp.zoneAt(met) : null;
    const { factor, unit } = this.quantity();
    const text = words.view.reading({
      value: value === null ? null : measured(value * factor, unit),
      isDark: value === 0, zone, point: met ? met.point.map((value) => coordinate(value, 2 * this.camera.radius)) : null,
      stage: this.mode === "stages" && met ? this.lamp.stages.labels[this.lamp.stages.values[met.triangle]] : null,
    });
    return { text, value: value === null ? null : value * factor, unit, zone, point: met?.point ?? null };
  }

  /** The intensity in the direction of the point of the solid that is under the cursor. */
  intensityOn(eye, way) {
    const { positions, indices, origin } = this.picture.solid ?? {};
    const met = positions ? meets(positions, indices, eye, way, this.cutPlanes()) : null;
    if (!met) return { text: words.view.besideSolid, value: null, unit: null, zone: null, point: null };
    const { c, gamma } = this.lamp.directions.angles(met.point.map((value, k) => value - origin[k]));
    const value = intensityAt(this.lamp, c, gamma);
    const { unit } = this.quantity();
    return { text: words.view.intensity(measured(value, unit), significant(c, 3), significant(gamma, 3)), value, unit, zone: null, point: met.point };
  }
}

/** Gives the graphics memory of pictures back once their page is left: a browser has only few of such pictures at a time. */
export function endWith(signal, views) {
  signal.addEventListener("abort", () => { for (const { picture } of views) picture.gl.getExtension("WEBGL_lose_context")?.loseContext(); });
}

/** Pictures with one camera, one scale and one pointer. */
export function link(views) {
  for (const view of views) view.links = views;
}
