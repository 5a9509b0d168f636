// The page of a model: the lamp to turn, its curves and colour, whether to trust it, and what to take away.
import { ask, json } from "./api.js";
import { cartesian, polar, spectrum } from "./charts.js";
import { chooseOther } from "./choice.js";
import { button, confirmed, h, problem, put } from "./dom.js";
import { commands, downloads, newRays } from "./downloads.js";
import { headline, intensities, tristimulus } from "./facts.js";
import { chromaticity } from "./colour.js";
import { section } from "./goniogram.js";
import { colourOverAngle } from "./hue.js";
import { Illuminance } from "./illuminance.js";
import { Lamp } from "./lamp.js";
import { significant } from "./numbers.js";
import { quality, verdict } from "./quality.js";
import { endWith, View } from "./view.js";
import { words } from "./words.js";

/** A finished job as a lamp, with its report and what it is called. */
export async function fetched(job) {
  const file = (name) => ask(`${job.links.artifacts}/${name}`);
  const [glb, goniograms, report] = await Promise.all([
    file("emitter.glb").then((answer) => answer.arrayBuffer()),
    file("goniograms.json").then((answer) => answer.json()),
    file("report.json").then((answer) => answer.json()),
  ]);
  const title = job.channels.map((channel, k) => channel.name ?? report.inputs[k].name).join(" + ");
  return { job, report, title, lamp: new Lamp(glb, goniograms) };
}

/** Fills `page` with the model of a job that has succeeded. */
export async function modelPage(page, job, signal) {
  put(page, h("p", { class: "card" }, words.model.loading));
  const { lamp, report, title } = await fetched(job);
  document.title = words.title(title);
  const [curves, light] = [h("div", { class: "curves" }), h("div", {})];
  const draw = (zone) => {
    put(curves, charts(lamp, zone));
    put(light, spectra(lamp, zone));
  };
  const pictured = picture(lamp, draw, signal);
  draw(null);
  put(page,
    h("div", { class: "row between" }, h("h1", {}, title), h("div", { class: "row" }, button(words.compare.choose, () => chooseOther(job)), again(job), removal(job))),
    headline(lamp, verdict(report)),
    h("div", { class: "lamp-page" },
      h("div", { class: "stack" }, pictured, new Illuminance(lamp, job, title, signal).element),
      h("div", { class: "stack" }, curves, light, colourOverAngle(lamp))),
    h("div", { class: "columns" },
      quality(report, job.notices),
      h("div", { class: "stack" }, await downloads(job, title), newRays(job), commands(job))));
}

/** The picture, or why there is none. */
function picture(lamp, onzone, signal) {
  try {
    const view = new View(lamp, onzone);
    endWith(signal, [view]);
    const notes = [];
    if (lamp.volume) notes.push(h("p", { class: "hint" }, words.model.volume));
    // For tests, and for who looks at numbers in the console.
    view.canvas.view = view;
    const { element } = view;
    element.append(...notes);
    return element;
  } catch (error) {
    return h("section", { class: "view" }, h("p", { class: "problem", role: "alert" }, words.model.noPicture(error.message)));
  }
}

/** The two pairs of half-planes of an entry's intensities, as curves of a chart. */
function planes(lamp, entry) {
  const { grid } = intensities(lamp, entry);
  return grid ? [0, 90].map((c, k) => ({ name: words.charts.plane(c, c + 180), kind: ["first", "second"][k], points: section(grid, lamp.directions, c) })) : null;
}

/** Curves of the whole, and of a zone where one is pointed at. */
function charts(lamp, zone) {
  const { total, zones } = lamp.goniograms;
  const { unit } = intensities(lamp, total);
  const entry = zone === null ? null : zones[zone];
  const zoned = entry ? planes(lamp, entry) : null;
  const both = (curves, title) => [polar(title, curves, unit), cartesian(title, curves, unit)];
  return [
    h("section", { class: "card", "aria-labelledby": "whole-title" },
      h("h2", { id: "whole-title" }, words.charts.whole),
      both(planes(lamp, total), words.charts.polar)),
    h("section", { class: zoned ? "card" : "card waiting", "aria-labelledby": "zone-title" },
      h("h2", { id: "zone-title" }, zone === null ? words.charts.zone : words.charts.zoneOf(zone)),
      zoned ? both(zoned, words.charts.zonePolar(zone)) : h("p", { class: "hint" }, entry ? words.charts.darkZone(zone) : words.charts.pointAt(zones.length)),
      entry ? h("p", {}, words.charts.zoneFacts(fluxes(entry), significant(entry.area_mm2, 3))) : null),
  ];
}

function fluxes(entry) {
  return [[entry.flux_lm, "lm"], [entry.flux_W, "W"]].filter(([flux]) => flux !== null && flux !== undefined)
    .map(([flux, unit]) => `${significant(flux, 3)} ${unit}`).join(", ");
}

function spectra(lamp, zone) {
  const { total, zones } = lamp.goniograms;
  const entry = zone === null ? null : zones[zone];
  if (!lamp.spectrum || !total.spectral_flux_W_per_nm) {
    return h("section", { class: "card", "aria-labelledby": "spectrum-title" }, h("h2", { id: "spectrum-title" }, words.charts.spectrum), h("p", { class: "hint" }, words.charts.noSpectrum));
  }
  const lists = [{ name: words.charts.whole, kind: "first", values: total.spectral_flux_W_per_nm }];
  if (entry?.spectral_flux_W_per_nm) lists.push({ name: words.charts.zoneOf(zone), kind: "second", values: entry.spectral_flux_W_per_nm });
  const point = chromaticity(tristimulus(lamp, total));
  return h("section", { class: "card", "aria-labelledby": "spectrum-title" }, h("h2", { id: "spectrum-title" }, words.charts.spectrum),
    spectrum(words.charts.spectrum, lamp.spectrum.band_edges_nm, lists),
    h("p", {}, !point ? words.facts.dark : words.charts.chromaticity(point.x.toFixed(4), point.y.toFixed(4), point.u.toFixed(4), point.v.toFixed(4))));
}

/** The same files with other options. */
function again(job) {
  const ids = job.channels.map((channel) => channel.ray_set);
  return h("a", { class: "button", href: `#/ray-sets/${ids.join(",")}` }, words.model.again);
}

export function removal(job) {
  return button(words.model.remove, async () => {
    if (!(await confirmed(words.model.remove, words.model.removeWhy, words.model.removeYes))) return;
    await json(job.links.self, { method: "DELETE" })
      .then(() => { location.hash = "#/"; })
      .catch((error) => document.getElementById("main").prepend(problem(error)));
  }, "danger");
}
