// Curves over a line: intensity over γ, light along a plane, colour over angle.
import { h, name, s } from "./dom.js";
import { significant } from "./numbers.js";

const [WIDE, TALL] = [320, 140];

/** Round numbers from `low` to `high`, about `count` of them. */
export function ticks(low, high, count) {
  const span = high - low;
  if (!(span > 0)) return [low];
  const power = 10 ** Math.floor(Math.log10(span / count));
  const step = [1, 2, 5, 10].map((times) => times * power).find((size) => span / size <= count) ?? 10 * power;
  const out = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * span; k += 1) out.push(k * step);
  return out;
}

/** Where a line of the drawing is in the key. */
export function line(kind) {
  return s("svg", { viewBox: "0 0 24 8", class: "stroke", "aria-hidden": "true" }, s("path", { d: "M1 4H23", class: kind }));
}

/**
 * Curves, each with a `name`, a `kind` (class of its line) and `points`, `[x, y]` in order of x. `across` is what x is; `unit` that of y.
 * `marks`: places of x that are marked. `ticksAcross`: where x has numbers, else round ones. `below` stands under the drawing.
 */
export function graph(title, curves, { across, unit, least = 0, most = null, marks = [], stepAcross = null, below = null }) {
  const xs = curves.flatMap(({ points }) => points.map(([x]) => x));
  const [first, last] = [Math.min(...xs), Math.max(...xs)];
  const top = most ?? Math.max(...curves.flatMap(({ points }) => points.map(([, y]) => y)), least + 1e-30);
  const upTo = ticks(least, top, 4);
  const high = upTo.at(-1) < top ? upTo.at(-1) + (upTo[1] ?? top) - upTo[0] : upTo.at(-1);
  const rows = ticks(least, high, 5);
  const x = (value) => (WIDE * (value - first)) / (last - first || 1);
  const y = (value) => TALL * (1 - (value - least) / (high - least || 1));
  const columns = stepAcross ? stepAcross.filter((value) => value >= first && value <= last) : ticks(first, last, 6);
  const id = name("graph");
  const path = (points) => `M${points.map(([at, value]) => `${x(at).toFixed(1)} ${y(value).toFixed(1)}`).join("L")}`;
  const drawing = s("svg", { viewBox: `-40 -8 ${WIDE + 50} ${TALL + 26}`, role: "img", "aria-labelledby": id, class: "chart graph" },
    s("title", { id }, title),
    rows.map((value) => [s("line", { x1: 0, x2: WIDE, y1: y(value), y2: y(value), class: "grid" }), s("text", { x: -4, y: y(value) + 3.4, class: "tick right" }, short(value))]),
    columns.map((value) => [s("line", { x1: x(value), x2: x(value), y1: 0, y2: TALL, class: "grid" }), s("text", { x: x(value), y: TALL + 13, class: "tick" }, short(value))]),
    marks.map((value) => s("line", { x1: x(value), x2: x(value), y1: 0, y2: TALL, class: "here" })),
    curves.map(({ points, kind }) => s("path", { d: path(points), class: kind })));
  return h("figure", {}, drawing, below,
    h("figcaption", {}, `${unit ? `${unit}; ` : ""}${across}`),
    curves.length > 1 ? h("ul", { class: "key" }, curves.map(({ name: text, kind }) => h("li", {}, line(kind), text))) : null);
}

/** A number of an axis: no more digits than it needs. */
function short(value) {
  return Math.abs(value) < 1e-12 ? "0" : String(Number(value.toPrecision(6))).replace("-", "−").length <= 7
    ? String(Number(value.toPrecision(6))).replace("-", "−") : significant(value, 3);
}
