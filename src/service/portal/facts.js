// What a lamp is in a few numbers: flux, peak intensity, beam, colour, size.
import { chromaticity, dominant, swatch, temperature } from "./colour.js";
import { h } from "./dom.js";
import { halfWidth, section } from "./goniogram.js";
import { count, significant } from "./numbers.js";
import { words } from "./words.js";

/** The intensities of an entry, and their unit: luminous where the lamp is. */
export function intensities(lamp, entry) {
  return lamp.isLuminous
    ? { grid: entry.luminous_intensity_cd, unit: "cd" }
    : { grid: entry.radiant_intensity_W_per_sr, unit: "W/sr" };
}

function fact(name, value, more, mark) {
  return h("div", { class: "fact" }, h("dt", {}, name), h("dd", {}, h("strong", {}, mark, value), more ? h("span", {}, more) : null));
}

/** Figures of a lamp as texts: what it is, and more of it. */
export function figures(lamp) {
  const { total, source } = lamp.goniograms;
  const { grid, unit } = intensities(lamp, total);
  const peak = greatest(grid, lamp.directions);
  const widths = [0, 90].map((c) => halfWidth(section(grid, lamp.directions, c)));
  const fluxes = [[total.flux_lm, "lm"], [total.flux_W, "W"]].filter(([flux]) => flux !== null && flux !== undefined);
  if (!lamp.isLuminous) fluxes.reverse();
  const size = lamp.box.min.map((low, k) => significant(lamp.box.max[k] - low, 3));
  return {
    peak, widths,
    flux: [fluxes.map(([flux, name]) => `${significant(flux, 4)} ${name}`)[0] ?? "–", fluxes.slice(1).map(([flux, name]) => `${significant(flux, 4)} ${name}`).join(", ")],
    intensity: [`${significant(peak.value, 4)} ${unit}`, words.facts.at(significant(peak.c, 3), significant(peak.gamma, 3))],
    beam: [widths.every((width) => width === null) ? words.facts.noBeam : widths.map((width) => (width === null ? "–" : `${significant(width, 3)}°`)).join(" × "), words.facts.beamOf],
    size: [`${size.join(" × ")} mm`, words.facts.rays(count(source.ray_count))],
  };
}

/** The headline of a model: a list of facts. */
export function headline(lamp, trust) {
  const all = figures(lamp);
  return h("dl", { class: "facts" },
    fact(words.facts.flux, ...all.flux), fact(words.facts.peak, ...all.intensity), fact(words.facts.beam, ...all.beam),
    colourFact(lamp),
    fact(words.facts.size, ...all.size),
    trust ? fact(words.facts.trust, trust.short, h("a", { href: "#quality", onclick: (event) => { event.preventDefault(); document.getElementById("quality").focus(); document.getElementById("quality").scrollIntoView(); } }, words.facts.why)) : null);
}

/** The node of the greatest intensity, the first of equal ones: as `max_intensity` of the file, which has no W/sr where lm are known. */
function greatest(grid, { c, gamma }) {
  let best = { value: -1 };
  grid.forEach((row, j) => row.forEach((value, k) => { if (value > best.value) best = { value, c: c[j], gamma: gamma[k] }; }));
  return best;
}

/** Its chromaticity, and the temperature or wavelength people call it by: a text, more of it, and X, Y, Z. */
export function colourOf(lamp) {
  const xyz = tristimulus(lamp, lamp.goniograms.total);
  if (!xyz) return [words.facts.unknown, words.facts.needsSpectrum, null];
  const point = chromaticity(xyz);
  if (!point) return [words.facts.dark, null, null];
  const warm = temperature(point);
  const nm = warm ? null : dominant(point);
  const called = warm ? words.facts.kelvin(count(Math.round(warm.kelvin / 10) * 10)) : nm ? words.facts.dominant(Math.round(nm)) : words.facts.purple;
  return [called, words.facts.xy(point.x.toFixed(4), point.y.toFixed(4), warm ? warm.duv.toFixed(4) : null), xyz];
}

function colourFact(lamp) {
  const [called, more, xyz] = colourOf(lamp);
  if (!xyz) return fact(words.facts.colour, called, more);
  const mark = h("span", { class: "swatch", "aria-hidden": "true" });
  mark.style.background = swatch(xyz);
  return fact(words.facts.colour, called, more, mark);
}

/** X, Y, Z of an entry's flux; null where no spectrum is known. */
export function tristimulus(lamp, entry) {
  if (entry.spectral_flux_W_per_nm && lamp.weigh) return lamp.weigh(entry.spectral_flux_W_per_nm);
  if (lamp.spectrum || !lamp.hasColour) return null;
  const xyz = [0, 0, 0];
  lamp.areas.forEach((area, vertex) => xyz.forEach((_, axis) => { xyz[axis] += area * lamp.exitance[4 * vertex + axis]; }));
  return xyz;
}
