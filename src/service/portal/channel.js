// One ray file of a source: its verdicts in plain words, its drawings, and what is asked of it.
import { address, ask, json } from "./api.js";
import { amount, button, confirmed, field, h, problem, put, select } from "./dom.js";
import { key } from "./keys.js";
import { bytes, count, significant, typed } from "./numbers.js";
import { notice } from "./quality.js";
import { words } from "./words.js";

const ORDER = { wrong: 0, notice: 1, ok: 2 };

/** A channel's card, and `claims()`: what goes into the job. `onchange()` when a declaration changes; `isOne`: it has no others beside it. */
export function channel(set, isOne, onchange) {
  const said = { length_unit: "", quantity: "", flux: "", fluxValue: "", spectrum: null };
  const asked = questions(set, said, onchange);
  const { inspection } = set;
  const answered = () => ({
    unit: asked.needsUnit && Boolean(said.length_unit), quantity: asked.needsQuantity && Boolean(said.quantity),
  });
  const checks = h("div", {});
  const show = () => put(checks, inspection ? verdicts(set, answered(), asked.checks) : h("p", {}, words.channel.noInspection));
  show();
  const element = h("article", { class: "card channel", "aria-label": set.name },
    h("div", { class: "row between" }, h("h2", {}, set.name), remove(set)),
    h("p", { class: "hint" }, words.channel.facts(set.header.format, count(set.header.ray_count), bytes(set.byte_count), fluxes(set))),
    asked.form,
    checks,
    h("div", { class: "drawings" },
      drawing(set.links.origins, words.channel.origins, words.channel.originsOf(set.name)),
      drawing(set.links.far_field, words.channel.farField, words.channel.farFieldOf(set.name))),
    declarations(set, said, isOne, onchange),
    texts(set.header.texts));
  asked.onanswer(show);
  return { element, claims: () => claims(set, said), missing: () => [...asked.missing(), ...(said.flux && !(typed(said.fluxValue) > 0) ? [words.channel.fluxMissing] : [])], needs: asked };
}

/** What the file gives of light. */
function fluxes({ header, inspection }) {
  const flux = inspection?.flux ?? header.flux;
  const all = [[flux.luminous_lm, "lm"], [flux.radiant_w, "W"]].filter(([value]) => value !== null);
  return header.quantity_unknown ? "" : all.map(([value, unit]) => `${significant(value, 4)} ${unit}`).join(", ");
}

/** What the file does not say, asked for in place. */
function questions(set, said, onchange) {
  const needsUnit = !set.header.length_unit && !set.declared.length_unit;
  const needsQuantity = set.header.quantity_unknown && !set.declared.quantity;
  let tell = () => {};
  const answer = (name) => (value) => {
    said[name] = value;
    tell();
    onchange();
  };
  const box = set.inspection?.origins_mm;
  const size = box ? box.min.map((low, k) => significant(box.max[k] - low, 3)).join(" × ") : null;
  const controls = [
    needsUnit ? field(words.channel.unit, select([["", words.channel.choose], ...words.units], "", answer("length_unit")), size ? words.channel.unitHint(size) : null) : null,
    needsQuantity ? field(words.channel.quantity, select([["", words.channel.choose], ...words.quantities], "", answer("quantity")), words.channel.quantityHint(significant(set.inspection?.radiant_sum ?? set.inspection?.luminous_sum, 4))) : null,
  ].filter(Boolean);
  const form = controls.length ? h("div", { class: "ask" }, h("h3", {}, words.channel.asked), h("div", { class: "row" }, controls)) : null;
  return {
    form, needsUnit, needsQuantity,
    checks: new Set([needsUnit ? "rays.length_unit" : null, needsQuantity ? "rays.quantity" : null]),
    onanswer: (listener) => { tell = listener; },
    missing: () => [needsUnit && !said.length_unit ? words.channel.unit : null, needsQuantity && !said.quantity ? words.channel.quantity : null].filter(Boolean),
  };
}

/** Every check with its verdict; what is answered above counts as well. */
function verdicts({ inspection, name }, answered, asked) {
  const settled = ({ check, verdict }) => ((check === "rays.length_unit" && answered.unit) || (check === "rays.quantity" && answered.quantity) ? "ok" : verdict);
  const checks = inspection.checks.map((check) => ({ ...check, settled: settled(check) }));
  const worst = checks.reduce((a, b) => (ORDER[b.settled] < ORDER[a] ? b.settled : a), "ok");
  const item = (check) => h("li", { class: `check ${check.settled}` },
    h("span", { class: "mark", role: "img", "aria-label": words.verdicts[check.settled] }, words.marks[check.settled]),
    h("div", {}, h("strong", {}, words.checks[check.check] ?? check.check), h("p", {}, check.message, check.settled !== "ok" && check.remedy ? [" ", h("em", {}, asked.has(check.check) ? words.channel.above : check.remedy)] : null)));
  const open = checks.filter(({ settled: verdict }) => verdict !== "ok").sort((a, b) => ORDER[a.settled] - ORDER[b.settled]);
  const fine = checks.filter(({ settled: verdict }) => verdict === "ok");
  return h("section", { class: "verdicts", "aria-label": words.channel.checks(name) },
    h("p", { class: `verdict ${{ ok: "good", notice: "fair", wrong: "poor" }[worst]}` }, h("strong", {}, words.channel.verdict[worst]), " ", words.channel.verdictMore[worst]),
    open.length ? h("ul", { class: "checks" }, open.map(item)) : null,
    h("details", {}, h("summary", {}, words.channel.fine(fine.length)), h("ul", { class: "checks" }, fine.map(item))),
    inspection.notices.length ? h("details", {}, h("summary", {}, words.channel.notices(inspection.notices.length)), h("ul", { class: "notices" }, inspection.notices.map(notice))) : null);
}

/** A drawing of the service. With a key the page fetches it: an image's own request carries none. */
function drawing(href, caption, text) {
  if (!href) return null;
  const place = h("div", { class: "drawing" });
  if (!key()) place.append(h("img", { src: address(href), alt: text, loading: "lazy" }));
  else {
    ask(href).then((answer) => answer.text()).then((markup) => {
      const drawn = new DOMParser().parseFromString(markup, "image/svg+xml").documentElement;
      drawn.setAttribute("role", "img");
      drawn.setAttribute("aria-label", text);
      const shadow = place.attachShadow({ mode: "open" });
      const sheet = new CSSStyleSheet();
      sheet.replaceSync(`svg { display: block; width: 100%; height: auto } ${[...drawn.querySelectorAll("style")].map((style) => style.textContent).join("\n")}`);
      shadow.adoptedStyleSheets = [sheet];
      shadow.append(document.importNode(drawn, true));
    }).catch((error) => put(place, problem(error)));
  }
  return h("figure", {}, place, h("figcaption", {}, caption));
}

/** What goes before the file's own word: spectrum and flux, folded away unless several files are joined. */
function declarations(set, said, isOne, onchange) {
  const status = h("p", { class: "hint", role: "status" });
  const chosen = h("span", {}, words.channel.noSpectrum);
  const load = async (event) => {
    const [file] = event.target.files;
    if (!file) return;
    try {
      const made = await json(`v1/spectra?name=${encodeURIComponent(file.name)}`, { method: "POST", body: file, headers: { "Content-Type": "application/octet-stream" } });
      said.spectrum = { id: made.id };
      chosen.textContent = words.channel.spectrumIs(made.name, significant(made.range_nm[0], 4), significant(made.range_nm[1], 4), significant(made.lm_per_w, 3));
      put(status);
      onchange();
    } catch (error) {
      put(status, problem(error));
    }
  };
  const value = amount((text) => { said.fluxValue = text; onchange(); });
  const kind = select(words.channel.fluxes, "", (chosenKind) => {
    said.flux = chosenKind;
    value.disabled = !chosenKind;
    onchange();
  });
  const file = h("input", { type: "file", onchange: load });
  return h("details", { open: !isOne }, h("summary", {}, words.channel.more),
    h("div", { class: "row" },
      field(words.channel.flux, kind, words.channel.fluxHint), field(words.channel.fluxValue, value, words.typed),
      h("div", {}, field(words.channel.spectrum, file, words.channel.spectrumHint), h("p", { class: "hint" }, chosen))),
    status);
}

function claims(set, said) {
  const number = typed(said.fluxValue);
  return {
    ray_set: set.id,
    ...(said.length_unit ? { length_unit: said.length_unit } : {}),
    ...(said.quantity ? { quantity: said.quantity } : {}),
    ...(said.flux && number > 0 ? { flux: { [said.flux]: said.flux.endsWith("share") ? number / 100 : number } } : {}),
    ...(said.spectrum ? { spectrum: said.spectrum } : {}),
  };
}

function texts(list) {
  if (!list?.length) return null;
  return h("details", {}, h("summary", {}, words.channel.says), h("dl", { class: "texts" }, list.map(({ name, value }) => [h("dt", {}, name), h("dd", {}, value)])));
}

function remove(set) {
  return button(words.channel.remove, async () => {
    if (!(await confirmed(words.channel.remove, words.channel.removeWhy(set.name), words.channel.removeYes))) return;
    await json(set.links.self, { method: "DELETE" })
      .then(() => { location.hash = "#/"; })
      .catch((error) => document.getElementById("main").prepend(problem(error)));
  }, "danger");
}
