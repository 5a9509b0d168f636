// The first page: send files, try the sample, go on with what is here already.
import { address, ask, json, sleep } from "./api.js";
import { announce, button, h, problem, put } from "./dom.js";
import { bytes, count, when } from "./numbers.js";
import { send, transfers } from "./transfers.js";
import { words } from "./words.js";

/** So many of each list stand on the page at first. */
const SHOWN = 6;
/** What one answer may list. */
const MOST_SHOWN = 100;
const LOOK_AGAIN_MS = 3000;
/** Names of ray sets by their ids; null where a set is gone. */
const known = new Map();
const joining = h("div", { class: "stack" });
const SAMPLE = "portal/sample.tm25ray";
const SAMPLE_NAME = "four-chips.tm25ray";

export async function homePage(page) {
  document.title = words.title(words.home.short);
  const models = h("section", { "aria-labelledby": "models-title" }, h("h2", { id: "models-title" }, words.home.models), h("p", { class: "hint" }, words.loading));
  const raySets = h("section", { "aria-labelledby": "ray-sets-title" }, h("h2", { id: "ray-sets-title" }, words.home.raySets), h("p", { class: "hint" }, words.loading));
  put(page,
    h("div", { class: "hero" }, h("h1", {}, words.home.title), h("p", { class: "lead" }, words.home.lead)),
    dropZone(),
    transfers((ids) => { location.hash = `#/ray-sets/${ids.join(",")}`; }),
    h("div", { class: "columns" }, models, raySets));
  limits();
  await recent(models, raySets);
}

/** Where files are dropped or chosen. */
function dropZone() {
  const input = h("input", { type: "file", multiple: true, id: "files", class: "unseen", onchange: () => { send(input.files); input.value = ""; } });
  const status = h("p", { class: "hint", role: "status" });
  const over = (is) => (event) => {
    event.preventDefault();
    zone.classList.toggle("over", is);
  };
  const zone = h("div", {
    class: "drop", ondragenter: over(true), ondragover: over(true), ondragleave: over(false),
    ondrop: (event) => {
      over(false)(event);
      if (event.dataTransfer.files.length) send(event.dataTransfer.files);
    },
  },
  h("p", { class: "big" }, words.home.drop),
  h("div", { class: "row middle" },
    input, h("label", { for: "files", class: "button first" }, words.home.choose),
    button(words.home.sample, () => sample(status))),
  status,
  h("p", { class: "hint" }, words.home.formats),
  h("p", { class: "hint", id: "limits" }, words.home.packed));
  return zone;
}

/** How large a file may be, before one is sent. */
async function limits() {
  const answer = await fetch(address("v1/uploads"), { method: "OPTIONS" }).catch(() => null);
  const most = Number(answer?.headers.get("Tus-Max-Size"));
  const told = document.getElementById("limits");
  if (most && told) told.textContent = `${words.home.packed} ${words.home.most(bytes(most))}`;
}

/** The built-in sample takes the way of any file, unless it is here already. */
async function sample(status) {
  try {
    put(status, words.home.sampleComes);
    const digest = (await ask(SAMPLE, { method: "HEAD" })).headers.get("ETag").replaceAll(/W\/|"/g, "");
    const { ray_sets: known } = await json(`v1/ray-sets?sha256=${digest}&limit=1`);
    if (known.length) {
      location.hash = `#/ray-sets/${known[0].id}`;
      return;
    }
    const file = await (await ask(SAMPLE)).blob();
    send([new File([file], SAMPLE_NAME)]);
    put(status, "");
  } catch (error) {
    put(status, problem(error));
  }
}

/** Lists what is here, newest first; looks again while a model is being computed. */
async function recent(models, raySets) {
  await Promise.all([
    listed(models, "v1/jobs?evaluation=false&", "jobs", words.home.noModels, async (jobs, place) => {
      const names = await namesOf(jobs);
      put(place, jobs.map((job) => model(job, names)));
    }),
    listed(raySets, "v1/ray-sets?", "ray_sets", words.home.noRaySets, (sets, place) => choice(sets, place)),
  ]);
}

/** One list with its pages: `show(entries, place)` draws all that were fetched. */
async function listed(section, path, member, none, show) {
  const place = h("ul", { class: "cards" });
  const more = h("div", { class: "row" });
  const failed = h("div", {});
  let [entries, isAll] = [[], false];
  const fetchAll = async (isAsked = false) => {
    const page = await json(`${path}limit=${isAll ? MOST_SHOWN : SHOWN + 1}`);
    // Who is on an entry stays there.
    if (!isAsked && place.contains(document.activeElement)) return;
    entries = page[member];
    await show(isAll ? entries : entries.slice(0, SHOWN), place);
    const isCut = !isAll && entries.length > SHOWN;
    put(more, isCut ? button(words.home.all, showRest) : isAll && page.next ? h("p", { class: "hint" }, words.home.newest(MOST_SHOWN)) : null);
  };
  /** The entries that were left out; the first of them takes the focus of the button that is gone. */
  const showRest = async () => {
    isAll = true;
    if (await fetchAgain(true)) place.children[SHOWN]?.querySelector("a").focus();
  };
  /** Whether asking once more may help: not without a key. What went wrong stands below the list until it is mended. */
  const fetchAgain = (isAsked) => fetchAll(isAsked).then(() => { put(failed); return true; }, (error) => {
    put(failed, problem(error));
    return error.status !== 401;
  });
  await fetchAll();
  put(section, section.firstChild, entries.length ? [place, failed, more] : h("p", { class: "hint" }, none), member === "ray_sets" && entries.length ? joining : null);
  while (entries.some(({ state }) => state === "queued" || state === "running")) {
    await sleep(LOOK_AGAIN_MS);
    if (!section.isConnected || !(await fetchAgain())) return;
  }
}

/** Names of the ray sets that jobs were made of; those of deleted ones are not known any more. */
export async function namesOf(jobs) {
  const ids = new Set(jobs.flatMap(({ channels }) => channels.filter(({ name }) => !name).map(({ ray_set: id }) => id)));
  await Promise.all([...ids].filter((id) => !known.has(id)).map((id) => json(`v1/ray-sets/${id}`).then((set) => known.set(id, set.name)).catch(() => known.set(id, null))));
  return known;
}

export function nameOf(job, names) {
  if (job.evaluation) return words.job.evaluation;
  return job.channels.map(({ name, ray_set: id }) => name ?? names.get(id)).filter(Boolean).join(" + ") || words.home.unnamed;
}

function model(job, names) {
  return h("li", {}, h("a", { class: "card tile", href: `#/jobs/${job.id}` },
    h("strong", {}, nameOf(job, names)),
    h("span", { class: `state ${job.state}` }, words.states[job.state]),
    h("span", { class: "hint" }, when(job.finished_ms ?? job.created_ms))));
}

/** Ray sets, to open one or to join several to one source. */
function choice(sets, place) {
  const join = h("a", { class: "button first", hidden: true, href: "#/" }, "");
  // What is ticked stays so when the list is drawn anew.
  const chosen = new Set([...place.querySelectorAll("input:checked")].map(({ value }) => value));
  const update = () => {
    join.hidden = chosen.size < 2;
    join.textContent = words.home.join(chosen.size);
    join.href = `#/ray-sets/${[...chosen].join(",")}`;
    return chosen.size >= 2;
  };
  put(place, sets.map((set) => h("li", { class: "card tile with-box" },
    h("input", { type: "checkbox", value: set.id, checked: chosen.has(set.id), "aria-label": words.home.choose1(set.name), onchange: (event) => {
      if (event.target.checked) chosen.add(set.id);
      else chosen.delete(set.id);
      if (update()) announce(join.textContent);
    } }),
    h("a", { href: `#/ray-sets/${set.id}` }, h("strong", {}, set.name)),
    h("span", {}, set.header.format),
    h("span", { class: "hint" }, words.home.setFacts(count(set.header.ray_count), bytes(set.byte_count), when(set.created_ms))))));
  put(joining, h("p", { class: "hint" }, words.home.joinHint), join);
  update();
}
