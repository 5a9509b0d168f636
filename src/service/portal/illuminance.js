// Light on a plane: a slider for its distance, its picture with a scale, a cursor that reads values, sections, and the same as files.
import { sleep } from "./api.js";
import { GRADIENT } from "./colour.js";
import { command, curl } from "./command.js";
import { announce, button, field, h, name, problem, put, select } from "./dom.js";
import { Evaluation, evaluations } from "./evaluation.js";
import { graph } from "./graph.js";
import { ceiling, coordinate, measured, percent, prefixed, significant, typed } from "./numbers.js";
import { LEVELS, Lit, Plane, STEPS } from "./plane.js";
import { words } from "./words.js";

/** So long a slider rests before the service is asked. */
const SOON_MS = 140;
/** So long a cursor that keys move rests before its value is said. */
const SAY_MS = 450;
/** After an answer that took longer, a finer one would keep the service busy for too long: it ends after 20 s. */
const SLOW_MS = 4000;
const FORMS = ["csv", "tiff", "svg"];

export class Illuminance {
  /** Once `signal` says that the page is left, nothing more is asked. */
  constructor(lamp, job, title, signal) {
    Object.assign(this, { lamp, job, title });
    this.plane = new Plane(lamp);
    this.evaluation = new Evaluation(job);
    Object.assign(this, { decades: 0, isHeld: false, greatest: null, lit: null, cursor: null, running: new AbortController() });
    signal.addEventListener("abort", () => this.running.abort());
    this.build();
    // A page that is opened asks nothing of the service until somebody looks at this part of it.
    new IntersectionObserver((seen, watcher) => {
      if (!seen.some(({ isIntersecting }) => isIntersecting)) return;
      watcher.disconnect();
      this.ask();
    }, { rootMargin: "200px" }).observe(this.element);
  }

  build() {
    const id = name("plane");
    this.canvas = h("canvas", { class: "plane", tabindex: 0, role: "img", width: 2, height: 2, "aria-label": words.plane.canvas, "aria-describedby": `${id}-help` });
    this.cross = h("div", { class: "cross", hidden: true });
    this.ways = [h("span", { class: "way up" }), h("span", { class: "way right" })];
    this.value = h("output", { class: "reading" }, words.plane.point);
    this.ramp = h("div", { class: "ramp" });
    this.ramp.style.background = GRADIENT;
    this.ticks = h("div", { class: "ticks" });
    this.legend = h("div", { class: "legend", role: "img", hidden: true }, this.ramp, this.ticks);
    this.figures = h("dl", { class: "figures" });
    this.sections = h("div", { class: "stack" });
    this.status = h("p", { class: "hint", role: "status" });
    this.failed = h("div", {});
    this.command = command(words.plane.command, "");
    this.element = h("section", { class: "card plane-card", "aria-labelledby": id },
      h("h2", { id }, words.plane.title),
      this.controls(),
      this.shown = h("div", { class: "plane-page" },
        h("div", { class: "stack" }, h("div", { class: "stage square" }, this.canvas, this.cross, this.ways), this.legend, this.value),
        h("div", { class: "stack" }, this.figures, this.sections)),
      this.status, this.failed,
      h("div", { class: "row" }, FORMS.map((form) => button(words.plane.save[form], () => this.save(form)))),
      h("details", {}, h("summary", {}, words.plane.show), this.command.element),
      h("p", { class: "hint", id: `${id}-help` }, words.plane.help));
    this.listen();
    this.told();
  }

  /** The distance by a slider and by a number, the side, the width, which light, and the scale. */
  controls() {
    const { plane, lamp } = this;
    this.slider = h("input", { type: "range", min: 0, max: STEPS, value: plane.step, class: "wide", oninput: () => this.move(() => { plane.step = Number(this.slider.value); }) });
    const number = (set, mayBeEmpty) => h("input", { inputmode: "decimal", autocomplete: "off", oninput: ({ target }) => {
      const isEmpty = target.value.trim() === "";
      const value = isEmpty ? null : typed(target.value);
      const isWrong = isEmpty ? !mayBeEmpty : !(value > 0);
      target.setAttribute("aria-invalid", isWrong);
      if (isWrong) put(this.status, isEmpty ? words.plane.empty : words.plane.wrong);
      else this.move(() => set(value));
    }, onblur: ({ target }) => {
      // What was left empty or wrong is given up for the plane that is shown.
      if (target.getAttribute("aria-invalid") !== "true") return;
      target.setAttribute("aria-invalid", "false");
      put(this.status);
      target.value = target === this.distance ? String(plane.distance) : plane.width ?? "";
    } });
    this.distance = number((value) => { plane.distance = value; }, false);
    this.width = number((value) => { plane.width = value; }, true);
    const lights = ["luminous", "radiant", "color"].filter((light) => ({ luminous: lamp.isLuminous, radiant: lamp.isRadiant, color: lamp.hasColour }[light]));
    return h("div", { class: "stack" },
      h("div", { class: "row distance" }, field(words.plane.distance, this.slider), field(words.plane.mm, this.distance)),
      h("div", { class: "row" },
        field(words.plane.side, select(plane.sides.map(({ gamma, c, axis }, k) => [String(k), words.plane.sides(gamma, c, axis)]), "0", (side) => this.move(() => { plane.side = Number(side); }))),
        field(words.plane.width, this.width, words.plane.widthHint),
        field(words.plane.light, select(lights.map((light) => [light, words.plane.lights[light]]), plane.light, (light) => this.move(() => { plane.light = light; this.greatest = null; }))),
        field(words.view.range, select(words.view.ranges, "0", (decades) => { this.decades = Number(decades); this.paint(); })),
        h("label", { class: "check" }, h("input", { type: "checkbox", onchange: ({ target }) => { this.isHeld = target.checked; this.paint(); } }), words.view.hold)));
  }

  /** Changes the plane, then asks for its light. */
  move(change) {
    change();
    this.told();
    this.ask();
  }

  /** What the controls say of the plane as it is. */
  told() {
    const { plane } = this;
    const text = words.plane.at(significant(plane.distance, 3), significant(plane.sizes, 2));
    if (document.activeElement !== this.slider) this.slider.value = plane.step;
    this.slider.setAttribute("aria-valuetext", text);
    if (document.activeElement !== this.distance) this.distance.value = String(plane.distance);
    this.width.placeholder = String(plane.wide());
    this.asked(LEVELS.at(-1));
  }

  /** What is saved, and asked by the command: the plane with the points of a level. */
  asked(level) {
    this.question = this.plane.question(level);
    this.command.set(curl(evaluations(this.job), { json: this.question }));
  }

  /** Asks the service: soon a coarse answer comes, then finer ones in its place. What was asked before is not waited for. */
  async ask() {
    this.running.abort();
    this.running = new AbortController();
    const { signal } = this.running;
    this.element.setAttribute("aria-busy", "true");
    // What is shown is of another plane until the first answer comes.
    this.shown.classList.add("stale");
    try {
      const finest = this.plane.question(LEVELS.at(-1));
      if (!this.evaluation.known(finest)) await sleep(SOON_MS, signal);
      const level = signal.aborted ? null : await this.refine(this.evaluation.known(finest) ? LEVELS.slice(-1) : LEVELS, signal);
      if (signal.aborted) return;
      this.asked(level);
      const { columns, most, unit } = this.lit;
      put(this.status, level === LEVELS.at(-1) ? words.plane.done(columns, percent(level.tolerance)) : words.plane.slow(columns, percent(level.tolerance)));
      announce(words.plane.said(this.slider.getAttribute("aria-valuetext"), measured(most, unit)));
    } catch (error) {
      if (signal.aborted) return;
      put(this.status, this.lit && this.shown.classList.contains("stale") ? words.plane.before : "");
      put(this.failed, problem(error, h("p", {}, button(words.problem.again, () => this.ask()))));
    } finally {
      if (!signal.aborted) this.element.removeAttribute("aria-busy");
    }
  }

  /** Asks for one level after another, up to one that is slow; the last that was answered. */
  async refine(levels, signal) {
    let last = null;
    for (const level of levels) {
      const began = performance.now();
      if (!last) put(this.status, words.plane.comes);
      try {
        await this.take(this.plane.question(level), signal);
      } catch (error) {
        if (last && error.code === "evaluation.too_long") return last;
        throw error;
      }
      last = level;
      if (signal.aborted || performance.now() - began > SLOW_MS) return last;
    }
    return last;
  }

  async take(question, signal) {
    const answer = await this.evaluation.answer(question, signal, (found, seconds) => put(this.status, words.plane.busy(found.detail ?? found.title, seconds)));
    if (signal.aborted) return;
    put(this.failed);
    this.shown.classList.remove("stale");
    this.lit = new Lit(answer);
    this.paint();
  }

  /** The picture, its scale, its figures and sections. */
  paint() {
    const { lit, canvas } = this;
    if (!lit) return;
    if (!this.isHeld || !this.greatest) this.greatest = ceiling(lit.most) || 1;
    [canvas.width, canvas.height] = [lit.columns, lit.rows];
    canvas.getContext("2d").putImageData(lit.pixels(this.greatest, this.decades), 0, 0);
    const { up, right } = lit.directions;
    put(this.ways[0], up ? `${up} ↑` : "");
    put(this.ways[1], right ? `${right} →` : "");
    this.legend.hidden = lit.light === "color";
    const shown = prefixed(this.greatest, lit.unit);
    const at = (where) => this.greatest * shown.factor * (this.decades ? 10 ** (this.decades * (where - 1)) : where);
    put(this.ticks, [0, 0.25, 0.5, 0.75, 1].map((where) => h("span", {}, significant(at(where), 3), where === 1 ? ` ${shown.unit}` : "")));
    this.legend.setAttribute("aria-label", words.view.scale(measured(this.greatest, lit.unit)));
    this.tell();
    this.read();
  }

  /** Largest, mean and smallest value, how even they are, and how much of the light meets the plane. */
  tell() {
    const { lit, lamp: { goniograms: { total } } } = this;
    const isLuminous = lit.light !== "radiant";
    const whole = isLuminous ? total.flux_lm : total.flux_W;
    // Points are few: near the light their mean may come to a little more than there is.
    const part = whole > 0 ? lit.flux / whole : 0;
    const meets = part >= 1 ? words.plane.all(measured(whole, isLuminous ? "lm" : "W")) : `${measured(lit.flux, isLuminous ? "lm" : "W")}${whole > 0 ? ` (${percent(part)})` : ""}`;
    const fact = (text, value) => h("div", {}, h("dt", {}, text), h("dd", {}, value));
    put(this.figures,
      fact(words.plane.most, measured(lit.most, lit.unit)), fact(words.plane.mean, measured(lit.mean, lit.unit)),
      fact(words.plane.least, measured(lit.least, lit.unit)), fact(words.plane.even, lit.mean > 0 ? significant(lit.least / lit.mean, 2) : "–"),
      fact(words.plane.flux, meets),
      fact(words.plane.wide, `${significant(this.plane.wide(), 3)} mm`));
  }

  /** The value at the cursor, and the sections through it; without one, through the brightest place. */
  read() {
    const { lit } = this;
    if (!lit) return;
    const place = this.cursor ?? lit.brightest;
    const found = lit.at(place);
    if (this.cursor) {
      const wide = this.plane.wide();
      this.value.textContent = words.plane.reading({
        value: measured(found.value, lit.unit), bound: found.bound > 0 ? measured(found.bound, lit.unit) : null,
        point: found.point.map((value) => coordinate(value, wide)), xy: found.xy?.map((value) => value.toFixed(4)),
      });
    } else this.value.textContent = words.plane.point;
    this.cross.hidden = !this.cursor;
    if (this.cursor) [this.cross.style.left, this.cross.style.top] = this.cursor.map((part) => `${100 * part}%`);
    const { up, right } = lit.directions;
    const shown = prefixed(Math.max(lit.most, 1e-30), lit.unit);
    const curve = (isRow, kind, text) => ({ name: text, kind, points: lit.profile(place, isRow).map(([x, y]) => [x, y * shown.factor]) });
    put(this.sections, graph(words.plane.sections(Boolean(this.cursor)),
      [curve(true, "first", words.plane.along(right ?? "→")), curve(false, "second", words.plane.along(up ?? "↑"))],
      { across: words.plane.across, unit: shown.unit }));
  }

  place(at) {
    this.cursor = at;
    this.reading ??= requestAnimationFrame(() => {
      this.reading = null;
      this.read();
    });
  }

  listen() {
    const { canvas } = this;
    const point = (event) => {
      const box = canvas.getBoundingClientRect();
      const inside = (value) => Math.min(0.9999, Math.max(0, value));
      this.place([inside((event.clientX - box.left) / box.width), inside((event.clientY - box.top) / box.height)]);
    };
    canvas.addEventListener("pointermove", point);
    canvas.addEventListener("pointerdown", point);
    canvas.addEventListener("pointerleave", () => { if (document.activeElement !== canvas) this.place(null); });
    canvas.addEventListener("keydown", (event) => this.key(event));
  }

  key(event) {
    const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    const [u, v] = this.cursor ?? [0.5, 0.5];
    const inside = (value) => Math.min(0.9999, Math.max(0, value));
    const far = (event.shiftKey ? 8 : 1) / 64;
    if (way) this.place([inside(u + far * way[0]), inside(v + far * way[1])]);
    else if (event.key === "Home") this.place([0.5, 0.5]);
    else if (event.key === "End" && this.lit) this.place(this.lit.brightest);
    else if (event.key === "Enter") this.place([u, v]);
    else return;
    event.preventDefault();
    clearTimeout(this.saying);
    this.saying = setTimeout(() => {
      // The picture's own turn may come later than this on a busy machine.
      this.read();
      announce(this.value.textContent);
    }, event.key === "Enter" ? 0 : SAY_MS);
  }

  async save(form) {
    put(this.failed);
    await this.evaluation.save(this.question, form, `${this.title} ${words.plane.file(this.plane.distance)}.${form}`.replaceAll("/", "-"))
      .catch((error) => put(this.failed, problem(error)));
  }
}
