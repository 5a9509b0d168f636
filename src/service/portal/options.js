// The options of a job, folded away: what is left alone is chosen from the rays.
import { field, h, select } from "./dom.js";
import { words } from "./words.js";

/** `element`, and `chosen()`: the options of a job. */
export function options(onchange) {
  const said = {};
  const set = (name) => (value) => {
    said[name] = value;
    onchange();
  };
  const choice = (name) => field(words.options[name].label, select(words.options[name].choices, "", set(name)), words.options[name].hint);
  const number = (name, step) => field(words.options[name].label,
    h("input", { type: "number", min: 0, step, placeholder: words.options.auto, oninput: (event) => set(name)(event.target.value) }), words.options[name].hint);
  const element = h("details", { class: "options" }, h("summary", {}, words.options.title),
    h("p", { class: "hint" }, words.options.why),
    h("div", { class: "row top" }, choice("emission"), choice("zoning"), number("columns", 1), number("rows", 1),
      number("resolution", 1), choice("nadir"), choice("c0"), number("gammaStep", 0.5), number("cStep", 1), choice("smoothing"), choice("priority")));
  return { element, chosen: () => chosen(said), priority: () => said.priority || undefined };
}

function chosen(said) {
  const given = (members) => Object.fromEntries(Object.entries(members).filter(([, value]) => value !== undefined && value !== ""));
  const number = (text) => (text ? Number(text) : undefined);
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
