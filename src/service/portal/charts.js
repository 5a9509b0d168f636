// Charts of the model page: polar curves and spectra, with tables behind them.
import { ofWavelength } from "./colour.js";
import { h, name, s, table } from "./dom.js";
import { graph, line } from "./graph.js";
import { significant } from "./numbers.js";
import { words } from "./words.js";

/** Polar curves; each has a `name`, a `kind` (class of its line) and `points`: `[γ, intensity]` with γ from -180 to 180 degrees. */
export function polar(title, curves, unit) {
  const most = Math.max(...curves.flatMap(({ points }) => points.map(([, value]) => value)), 1e-30);
  const ring = 10 ** Math.floor(Math.log10(most));
  const step = [1, 2, 5].map((times) => times * ring / (most / ring < 2 ? 5 : 1)).find((size) => most / size <= 5) ?? ring * 5;
  const rings = Math.ceil(most / step - 1e-9);
  const radius = 100;
  const at = (deg, value) => {
    const angle = (deg * Math.PI) / 180;
    const r = (radius * value) / (rings * step);
    return [r * Math.sin(angle), r * Math.cos(angle)];
  };
  const spokes = [0, 30, 60, 90, 120, 150, 180, -150, -120, -90, -60, -30];
  const id = name("polar");
  const drawing = s("svg", { viewBox: "-124 -118 248 236", role: "img", "aria-labelledby": id, class: "chart" },
    s("title", { id }, title),
    Array.from({ length: rings }, (_, k) => s("circle", { r: (radius * (k + 1)) / rings, class: "grid" })),
    spokes.map((deg) => s("line", { x2: at(deg, rings * step)[0], y2: at(deg, rings * step)[1], class: "grid" })),
    spokes.map((deg) => {
      const [x, y] = at(deg, rings * step * 1.1);
      return s("text", { x, y: y + 2.6, class: "tick" }, `${Math.abs(deg)}°`);
    }),
    curves.map(({ points, kind }) => s("path", { d: `M${points.map(([deg, value]) => at(deg, value).map((number) => number.toFixed(2)).join(" ")).join("L")}`, class: kind })),
    Array.from({ length: rings }, (_, k) => s("text", { x: 2, y: (radius * (k + 1)) / rings - 1.5, class: "tick left" }, significant(step * (k + 1), 3))));
  return h("figure", {}, drawing,
    h("figcaption", {}, words.charts.rings(significant(step, 3), unit)),
    h("ul", { class: "key" }, curves.map(({ name: text, kind }) => h("li", {}, line(kind), text))),
    values(title, curves, unit));
}

/** The same curves over γ; the dark half of what goes one way only is left out. */
export function cartesian(title, curves, unit) {
  const most = Math.max(...curves.flatMap(({ points }) => points.map(([, value]) => value)), 1e-30);
  const isHalf = curves.every(({ points }) => points.every(([deg, value]) => Math.abs(deg) <= 90 || value <= 1e-3 * most));
  const shown = isHalf ? curves.map((curve) => ({ ...curve, points: curve.points.filter(([deg]) => Math.abs(deg) <= 90) })) : curves;
  const step = isHalf ? 30 : 60;
  return graph(words.charts.cartesian(title), shown, { across: words.charts.gamma, unit, stepAcross: Array.from({ length: 13 }, (_, k) => step * (k - 6)) });
}

/** The numbers behind polar curves, every 10 degrees. */
function values(title, curves, unit) {
  const degrees = Array.from({ length: 37 }, (_, k) => 10 * k - 180);
  const used = degrees.filter((deg) => curves.some(({ points }) => points.some(([at]) => Math.abs(at - deg) < 5)));
  const between = (points, deg) => {
    const next = points.findIndex(([at]) => at >= deg);
    if (next < 0) return null;
    if (next === 0 || points[next][0] === deg) return points[next][1];
    const [[a, low], [b, high]] = [points[next - 1], points[next]];
    return low + ((deg - a) / (b - a)) * (high - low);
  };
  return h("details", {}, h("summary", {}, words.charts.numbers),
    table(`${title}, ${unit}`, [words.charts.angle, ...curves.map((curve) => curve.name)],
      used.map((deg) => [`${deg}°`, ...curves.map(({ points }) => {
        const value = between(points, deg);
        return value === null ? "" : significant(value, 3);
      })])));
}

/** Spectra over bands that they share: W/nm each; the first is filled with the colours of light. */
export function spectrum(title, edges, curves) {
  const [first, last] = [edges[0], edges.at(-1)];
  const most = Math.max(...curves.flatMap((curve) => curve.values), 1e-30);
  const [width, height] = [320, 150];
  const x = (nm) => ((nm - first) / (last - first)) * width;
  const y = (value) => height * (1 - value / most);
  const steps = (list) => list.map((value, band) => `L${x(edges[band]).toFixed(1)} ${y(value).toFixed(1)}L${x(edges[band + 1]).toFixed(1)} ${y(value).toFixed(1)}`).join("");
  const ids = [name("spectrum"), name("light")];
  const grid = Math.max(20, Math.ceil((last - first) / 6 / 50) * 50);
  const ticks = [];
  for (let nm = Math.ceil(first / grid) * grid; nm <= last; nm += grid) ticks.push(nm);
  const drawing = s("svg", { viewBox: `-6 -14 ${width + 12} ${height + 32}`, role: "img", "aria-labelledby": ids[0], class: "chart" },
    s("title", { id: ids[0] }, title),
    s("defs", {}, s("linearGradient", { id: ids[1] },
      Array.from({ length: 25 }, (_, k) => s("stop", { offset: k / 24, "stop-color": ofWavelength(first + (k / 24) * (last - first)) })))),
    ticks.map((nm) => [s("line", { x1: x(nm), x2: x(nm), y1: 0, y2: height, class: "grid" }), s("text", { x: x(nm), y: height + 12, class: "tick" }, nm)]),
    curves.map(({ values: list, kind }, k) => [
      k === 0 ? s("path", { d: `M0 ${height}${steps(list)}L${width} ${height}Z`, fill: `url(#${ids[1]})`, opacity: 0.75 }) : null,
      s("path", { d: `M0 ${height}${steps(list)}L${width} ${height}`, class: kind }),
    ]),
    s("text", { x: 0, y: -4, class: "tick left" }, `${significant(most, 3)} W/nm`));
  return h("figure", {}, drawing, h("figcaption", {}, words.charts.nanometres),
    curves.length > 1 ? h("ul", { class: "key" }, curves.map(({ name: text, kind }) => h("li", {}, line(kind), text))) : null,
    h("details", {}, h("summary", {}, words.charts.numbers),
      table(title, [words.charts.band, ...curves.map((curve) => `${curve.name}, W/nm`)],
        edges.slice(1).map((end, band) => [`${significant(edges[band], 4)}–${significant(end, 4)} nm`, ...curves.map((curve) => significant(curve.values[band], 3))]))));
}
