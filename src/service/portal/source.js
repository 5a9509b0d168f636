// The inspection as a page: one ray file or several joined to one source, what is missing asked for, then Build.
import { json } from "./api.js";
import { channel } from "./channel.js";
import { amount, announce, button, field, h, problem, put, select } from "./dom.js";
import { bytes, count, seconds, typed } from "./numbers.js";
import { options } from "./options.js";
import { notice } from "./quality.js";
import { words } from "./words.js";

const SOON_MS = 250;

export async function sourcePage(page, ids) {
  put(page, h("p", { class: "card" }, words.loading));
  const sets = await Promise.all(ids.map((id) => json(`v1/ray-sets/${encodeURIComponent(id)}`)));
  const name = sets.map((set) => set.name).join(" + ");
  document.title = words.title(name);
  const estimate = h("div", { class: "estimate", role: "status" });
  const failed = h("div", {});
  let soon = null;
  const changed = () => {
    clearTimeout(soon);
    soon = setTimeout(update, SOON_MS);
  };
  const channels = sets.map((set) => channel(set, sets.length === 1, changed));
  const chosen = options(changed);
  const total = { kind: "", value: "" };
  const request = () => ({
    channels: channels.map(({ claims }) => claims()),
    options: chosen.chosen(),
    ...(total.kind && typed(total.value) > 0 ? { total: { [total.kind]: typed(total.value) } } : {}),
    ...(chosen.priority() ? { priority: chosen.priority() } : {}),
  });
  const missing = () => [
    ...channels.flatMap(({ missing: lacks }, k) => lacks().map((what) => (sets.length > 1 ? `${sets[k].name}: ${what}` : what))),
    ...(total.kind && !(typed(total.value) > 0) ? [words.source.totalMissing] : []),
    ...chosen.missing(),
  ];
  const build = button(words.source.build, async () => {
    build.disabled = true;
    put(failed);
    try {
      const job = await json("v1/jobs", { json: request() });
      location.hash = `#/jobs/${job.id}`;
    } catch (error) {
      put(failed, problem(error));
    } finally {
      build.disabled = false;
    }
  }, "first large");
  async function update() {
    const lacks = missing();
    build.disabled = lacks.length > 0;
    put(failed);
    if (lacks.length) return put(estimate, h("p", {}, h("strong", {}, words.source.missing), " ", lacks.join("; ")));
    try {
      return put(estimate, estimated(await json("v1/jobs?dry_run=true", { json: request() })));
    } catch (error) {
      build.disabled = true;
      return put(estimate, problem(error));
    }
  }
  put(page,
    h("h1", {}, sets.length > 1 ? words.source.joined(sets.length) : words.source.one),
    sets.length > 1 ? h("p", { class: "lead" }, words.source.joinedWhy) : null,
    channels.map(({ element }) => element),
    h("section", { class: "card build", "aria-labelledby": "build-title" },
      h("h2", { id: "build-title" }, words.source.buildTitle),
      sets.length > 1 ? totals(total, changed) : null,
      chosen.element, estimate, failed,
      h("div", { class: "row" }, build, h("a", { href: "#/" }, words.source.addAnother))));
  await update();
  announce(words.source.ready(name));
}

/** The total of the source, of which each file has its share: as a data sheet says it. */
function totals(total, changed) {
  const value = amount((text) => { total.value = text; changed(); });
  const kind = select(words.source.totals, "", (chosen) => {
    total.kind = chosen;
    value.disabled = !chosen;
    changed();
  });
  return h("div", { class: "row" }, field(words.source.total, kind, words.source.totalHint), field(words.source.totalValue, value, words.typed));
}

/** What a job would take, or that its answer is here already. */
function estimated(found) {
  if (found.reuses) return h("p", {}, words.source.reuses, " ", h("a", { href: `#/jobs/${found.reuses}` }, words.source.open));
  return [
    h("p", {}, words.source.estimate({
      rays: count(found.ray_count), memory: bytes(found.memory_bytes),
      time: found.seconds === null ? null : seconds(found.seconds), ahead: found.jobs_ahead,
    })),
    found.fits ? null : h("p", { class: "problem", role: "alert" }, words.source.tooLarge(bytes(found.memory_limit_bytes))),
    found.notices.length ? h("ul", { class: "notices" }, found.notices.map(notice)) : null,
  ];
}
