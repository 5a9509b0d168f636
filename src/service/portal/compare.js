// Two models side by side: one camera, one scale, one pointer; their difference, and their figures in one table.
import { json } from "./api.js";
import { Camera } from "./camera.js";
import { cartesian, polar, spectrum } from "./charts.js";
import { Difference } from "./difference.js";
import { announce, h, put, table } from "./dom.js";
import { colourOf, figures, intensities } from "./facts.js";
import { section } from "./goniogram.js";
import { fetched } from "./model.js";
import { percent } from "./numbers.js";
import { verdict } from "./quality.js";
import { intensityAt, peakOf } from "./solid.js";
import { endWith, link, View } from "./view.js";
import { words } from "./words.js";

const KINDS = ["first", "second"];

export async function comparePage(page, ids, signal) {
  put(page, h("p", { class: "card" }, words.model.loading));
  const jobs = await Promise.all(ids.map((id) => json(`v1/jobs/${encodeURIComponent(id)}`)));
  if (jobs.some(({ state }) => state !== "succeeded")) throw Object.assign(new Error(words.compare.notReady), { title: words.compare.notReadyTitle });
  const models = await Promise.all(jobs.map(fetched));
  const [one, two] = models.map(({ lamp }) => lamp);
  document.title = words.title(words.compare.heading(...models.map(({ title }) => title)));
  if (one.isLuminous !== two.isLuminous) throw Object.assign(new Error(words.compare.otherUnits), { title: words.compare.otherUnitsTitle });
  one.solidPeak = two.solidPeak = Math.max(peakOf(one), peakOf(two));
  put(page,
    h("h1", {}, words.compare.heading(...models.map(({ title }) => title))),
    h("p", { class: "lead" }, words.compare.lead),
    ...pictures(models, signal, h("section", { class: "card", "aria-labelledby": "figures-title" }, h("h2", { id: "figures-title" }, words.compare.figures), table(words.compare.figures, [words.compare.figure, ...models.map(({ title }, k) => words.compare.column(k + 1, title)), words.compare.change], rows(models)))),
    h("div", { class: "columns three" }, curves(models)));
  announce(document.title);
}

/** The two pictures with what they share, and their difference beside the table of their figures. */
function pictures(models, signal, figuresTable) {
  try {
    const [one, two] = models.map(({ lamp }) => lamp);
    const box = { min: one.box.min.map((low, k) => Math.min(low, two.box.min[k])), max: one.box.max.map((high, k) => Math.max(high, two.box.max[k])) };
    const camera = new Camera(one.directions, box);
    const modes = ["seen", "true", "exitance", "solid"].filter((mode) => mode !== "true" || (one.hasColour && two.hasColour));
    const views = models.map(({ lamp, title }, k) => new View(lamp, () => {}, { camera, modes, label: words.compare.column(k + 1, title) }));
    link(views);
    endWith(signal, views);
    const difference = new Difference(...views);
    let isSoon = null;
    views.forEach((view) => {
      view.canvas.view = view;
      view.onpoint = (at) => difference.read(at);
      // Both rest at about the same time, and one difference is enough.
      view.onrest = () => { isSoon ??= requestAnimationFrame(() => { isSoon = null; difference.update(); }); };
    });
    const half = (view, k) => h("section", { class: "half", "aria-label": view.label },
      h("h2", {}, h("a", { href: `#/jobs/${models[k].job.id}` }, view.label)), view.stage, view.value);
    return [
      h("div", { class: "view" }, h("div", { class: "twins" }, views.map(half)),
        h("div", { class: "under" }, views[0].legend), views[0].controls,
        h("p", { class: "hint" }, views[0].axes.text), h("p", { class: "hint", id: "view-help" }, words.view.help)),
      h("div", { class: "columns" }, difference.element, figuresTable),
    ];
  } catch (error) {
    return [h("p", { class: "problem", role: "alert" }, words.model.noPicture(error.message)), figuresTable];
  }
}

/** Figures beside each other, and how the second differs from the first. */
function rows(models) {
  const [a, b] = models.map(({ lamp }) => ({ lamp, ...figures(lamp) }));
  const trusts = models.map(({ report }) => verdict(report));
  const change = (before, after) => (before > 0 ? words.compare.percent((100 * (after - before)) / before) : "–");
  const flux = (lamp) => (lamp.isLuminous ? lamp.goniograms.total.flux_lm : lamp.goniograms.total.flux_W);
  const { rms, most } = apart(a.lamp, b.lamp);
  return [
    [words.facts.flux, a.flux[0], b.flux[0], change(flux(a.lamp), flux(b.lamp))],
    [words.facts.peak, a.intensity.join(" "), b.intensity.join(" "), change(a.peak.value, b.peak.value)],
    [words.facts.beam, a.beam[0], b.beam[0], a.widths.map((width, k) => (width && b.widths[k] ? words.compare.degrees(b.widths[k] - width) : "–")).join(", ")],
    [words.facts.colour, ...[a, b].map(({ lamp }) => colourOf(lamp).slice(0, 2).filter(Boolean).join(" · ")), ""],
    [words.facts.size, a.size[0], b.size[0], ""],
    [words.compare.rays, a.size[1], b.size[1], ""],
    [words.facts.trust, ...trusts.map((trust) => (trust ? trust.worst : "–")), ""],
    [words.compare.intensity, "", "", words.compare.apart(percent(rms), percent(most))],
  ];
}

/** Root mean square, and most, of the difference of intensities over all directions, in parts of the first one's peak. */
function apart(one, two) {
  const peak = peakOf(one);
  let [sum, weights, most] = [0, 0, 0];
  const { directions } = one;
  const { grid } = intensities(one, one.goniograms.total);
  directions.c.forEach((c, j) => directions.gamma.forEach((gamma, k) => {
    const at = two.directions.angles(directions.vector(c, gamma));
    const part = (intensityAt(two, at.c, at.gamma) - grid[j][k]) / peak;
    sum += directions.weights[k] * part * part;
    weights += directions.weights[k];
    most = Math.max(most, Math.abs(part));
  }));
  return { rms: Math.sqrt(sum / weights), most };
}

/** Curves of both in one chart each: in the first one's planes of C. */
function curves(models) {
  const { unit } = intensities(models[0].lamp, models[0].lamp.goniograms.total);
  const [one, two] = models.map(({ lamp }) => lamp);
  const named = (k) => words.compare.column(k + 1, models[k].title);
  const other = (c) => [...one.directions.gamma.slice(1).reverse().map((gamma) => [-gamma, c + 180, gamma]), ...one.directions.gamma.map((gamma) => [gamma, c, gamma])]
    .map(([signed, plane, gamma]) => {
      const at = two.directions.angles(one.directions.vector(plane, gamma));
      return [signed, intensityAt(two, at.c, at.gamma)];
    });
  const cards = [0, 90].map((c) => {
    const title = words.compare.curves(words.charts.plane(c, c + 180));
    const both = [section(intensities(one, one.goniograms.total).grid, one.directions, c), other(c)].map((points, k) => ({ name: named(k), kind: KINDS[k], points }));
    return h("section", { class: "card", "aria-label": title }, h("h2", {}, title), polar(title, both, unit), cartesian(title, both, unit));
  });
  const lists = models.map(({ lamp }, k) => ({ name: named(k), kind: KINDS[k], values: lamp.goniograms.total.spectral_flux_W_per_nm, edges: lamp.spectrum?.band_edges_nm }));
  const isShared = lists.every(({ values, edges }) => values && edges && edges.join() === lists[0].edges.join());
  return [cards, isShared ? h("section", { class: "card", "aria-label": words.charts.spectrum }, h("h2", {}, words.charts.spectrum), spectrum(words.charts.spectrum, lists[0].edges, lists)) : null];
}
