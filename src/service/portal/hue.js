// Colour over angle: how far the light of each direction is from that of the whole source.
import { chromaticity, swatch } from "./colour.js";
import { h, s, table } from "./dom.js";
import { graph } from "./graph.js";
import { section, tristimulusGrid } from "./goniogram.js";
import { tristimulus } from "./facts.js";
import { words } from "./words.js";

/** Below this part of the peak there is too little light for a colour. */
const LEAST = 0.1;
/** What nobody sees: a hundredth of the first ellipse of MacAdam's or so. */
const ALIKE = 2e-4;
const EVERY_DEG = 10;

/** Sections of the lamp's colour that hold light: `[γ, chromaticity, distance in u′v′ from the whole, X Y Z]` each. */
function sectionsOf(lamp) {
  const grid = tristimulusGrid(lamp.goniograms, lamp.directions, lamp.spectrum, lamp.weigh);
  const whole = grid && chromaticity(tristimulus(lamp, lamp.goniograms.total));
  if (!whole) return null;
  const axis = (k) => grid.map((row) => row.map((xyz) => xyz[k]));
  const axes = [0, 1, 2].map(axis);
  const most = Math.max(...axes[1].flat());
  if (!(most > 0)) return [];
  const all = [0, 90].map((c, k) => {
    const [x, y, z] = axes.map((values) => section(values, lamp.directions, c));
    const list = y.map(([gamma, value], k) => {
      if (!(value >= LEAST * most)) return null;
      const xyz = [x[k][1], value, z[k][1]];
      const point = chromaticity(xyz);
      return { gamma, point, xyz, off: Math.hypot(point.u - whole.u, point.v - whole.v) };
    }).filter(Boolean);
    return { plane: words.charts.plane(c, c + 180), kind: ["first", "second"][k], list };
  });
  // A tilted beam sends nothing into some half-planes.
  return all.filter(({ list }) => list.length > 0);
}

/** A card with the chart, a ribbon of the colours and their numbers. */
export function colourOverAngle(lamp) {
  const sections = lamp.hasColour ? sectionsOf(lamp) : null;
  const card = (...content) => h("section", { class: "card", "aria-labelledby": "angle-title" }, h("h2", { id: "angle-title" }, words.hue.title), content);
  if (!sections) return card(h("p", { class: "hint" }, words.hue.unknown));
  if (!sections.length) return card(h("p", { class: "hint" }, words.hue.aside));
  const most = Math.max(...sections.flatMap(({ list }) => list.map(({ off }) => off)));
  if (most < ALIKE) return card(h("p", { class: "hint" }, words.hue.alike));
  const curves = sections.map(({ plane, kind, list }) => ({ name: plane, kind, points: list.map(({ gamma, off }) => [gamma, off]) }));
  const steps = Array.from({ length: 13 }, (_, k) => 30 * (k - 6));
  return card(
    graph(words.hue.chart, curves, { across: words.charts.gamma, unit: words.hue.unit, stepAcross: steps, below: ribbon(sections[0]) }),
    h("p", { class: "hint" }, words.hue.why),
    h("details", {}, h("summary", {}, words.charts.numbers), numbers(sections)));
}

/** The colours themselves along a section, each as bright as a screen makes it. */
function ribbon({ plane, list }) {
  const [first, last] = [list[0].gamma, list.at(-1).gamma];
  const edge = (k) => (k <= 0 ? first : k >= list.length ? last : (list[k - 1].gamma + list[k].gamma) / 2);
  const at = (gamma) => (320 * (gamma - first)) / (last - first || 1);
  return s("svg", { viewBox: "-40 0 370 14", class: "chart", role: "img", "aria-label": words.hue.ribbon(plane), "shape-rendering": "crispEdges" },
    list.map(({ xyz }, k) => s("rect", { x: at(edge(k)), y: 0, height: 14, width: Math.max(0.5, at(edge(k + 1)) - at(edge(k)) + 0.3), fill: swatch(xyz) })));
}

function numbers(sections) {
  const near = (list, gamma) => list.reduce((best, one) => (Math.abs(one.gamma - gamma) < Math.abs(best.gamma - gamma) ? one : best), list[0]);
  const all = Array.from({ length: 37 }, (_, k) => EVERY_DEG * k - 180).filter((gamma) => sections.some(({ list }) => Math.abs(near(list, gamma).gamma - gamma) <= EVERY_DEG / 4));
  return table(words.hue.chart, [words.charts.angle, ...sections.flatMap(({ plane }) => [`${plane}: u′, v′`, "Δu′v′"])],
    all.map((gamma) => [`${gamma}°`, ...sections.flatMap(({ list }) => {
      const found = near(list, gamma);
      if (Math.abs(found.gamma - gamma) > EVERY_DEG / 4) return ["", ""];
      return [`${found.point.u.toFixed(4)}, ${found.point.v.toFixed(4)}`, found.off.toFixed(4)];
    })]));
}
