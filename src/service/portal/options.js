// The options of a job, folded away: what is left alone is chosen from the rays.
import { field, h, select } from "./dom.js";
import { typed } from "./numbers.js";
import { words } from "./words.js";

/** What a number may be: from, to, whether it is whole, and what it must divide. */
const LIMITS = {
  columns: [1, 32, true], rows: [1, 32, true], resolution: [4, 256, true], gammaStep: [0.5, 30, false, 180], cStep: [1, 90, false, 360],
};

/** Whether a text is such a number. A browser's own field for numbers has an empty text for what it does not like, which says nothing. */
function isRight(name, text) {
  const [least, most, isWhole, whole] = LIMITS[name];
  const value = typed(text);
  if (value === null || value < least || value > most || (isWhole && !Number.isInteger(value))) return false;
  return !whole || Math.abs(whole / value - Math.round(whole / value)) < 1e-9;
}

/** `element`, `chosen()`: the options of a job, and `missing()`: what is typed and is no number that may be. */
export function options(onchange) {
  const said = {};
  const set = (name) => (value) => {
    said[name] = value;
    onchange();
  };
  const choice = (name) => field(words.options[name].label, select(words.options[name].choices, "", set(name)), words.options[name].hint);
  const number = (name) => field(words.options[name].label,
    h("input", { inputmode: "decimal", autocomplete: "off", placeholder: words.options.auto, oninput: ({ target }) => {
      target.setAttribute("aria-invalid", target.value.trim() !== "" && !isRight(name, target.value));
      set(name)(target.value.trim());
    } }), words.options[name].hint);
  const element = h("details", { class: "options" }, h("summary", {}, words.options.title),
    h("p", { class: "hint" }, words.options.why),
    h("div", { class: "row top" }, choice("emission"), choice("zoning"), number("columns"), number("rows"),
      number("resolution"), choice("nadir"), choice("c0"), number("gammaStep"), number("cStep"), choice("smoothing"), choice("priority")));
  const missing = () => Object.keys(LIMITS).filter((name) => said[name] && !isRight(name, said[name])).map((name) => words.options.wrong(words.options[name].label, words.options[name].hint));
  return { element, chosen: () => chosen(said), missing, priority: () => said.priority || undefined };
}

function chosen(said) {
  const given = (members) => Object.fromEntries(Object.entries(members).filter(([, value]) => value !== undefined && value !== ""));
  const number = (text) => (text ? typed(text) ?? undefined : undefined);
  const smoothing = said.smoothing === "off" ? false : undefined;
  const zones = said.columns || said.rows ? { columns: number(said.columns) ?? 1, rows: number(said.rows) ?? 1 } : undefined;
  const all = {
    hull: given({ emission: said.emission, resolution: number(said.resolution) }),
    flux: given({ smoothing }),
    goniogram: given({
      zoning: said.zoning, zones, nadir_axis: said.nadir, c0_axis: said.c0,
      gamma_step_deg: number(said.gammaStep), c_step_deg: number(said.cStep), smoothing,
    }),
  };
  return Object.fromEntries(Object.entries(all).filter(([, value]) => Object.keys(value).length));
}
