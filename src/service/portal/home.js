// The first page: send files, try the sample, go on with what is here already.
import { address, ask, json } from "./api.js";
import { announce, button, h, problem, put } from "./dom.js";
import { bytes, count, when } from "./numbers.js";
import { send, transfers } from "./transfers.js";
import { words } from "./words.js";

const SHOWN = 12;
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

async function recent(models, raySets) {
  const [{ jobs }, { ray_sets: sets }] = await Promise.all([json(`v1/jobs?limit=${SHOWN}`), json(`v1/ray-sets?limit=${SHOWN}`)]);
  const names = new Map(sets.map(({ id, name }) => [id, name]));
  put(models, models.firstChild, jobs.length ? h("ul", { class: "cards" }, jobs.map((job) => model(job, names))) : h("p", { class: "hint" }, words.home.noModels));
  put(raySets, raySets.firstChild, sets.length ? choice(sets) : h("p", { class: "hint" }, words.home.noRaySets));
}

export function nameOf(job, names) {
  return job.channels.map(({ name, ray_set: id }) => name ?? names.get(id)).filter(Boolean).join(" + ") || words.home.unnamed;
}

function model(job, names) {
  return h("li", {}, h("a", { class: "card tile", href: `#/jobs/${job.id}` },
    h("strong", {}, nameOf(job, names)),
    h("span", { class: `state ${job.state}` }, words.states[job.state]),
    h("span", { class: "hint" }, when(job.finished_ms ?? job.created_ms))));
}

/** Ray sets, to open one or to join several to one source. */
function choice(sets) {
  const chosen = new Set();
  const join = h("a", { class: "button first", hidden: true, href: "#/" }, "");
  const update = () => {
    join.hidden = chosen.size < 2;
    join.textContent = words.home.join(chosen.size);
    join.href = `#/ray-sets/${[...chosen].join(",")}`;
    if (chosen.size >= 2) announce(join.textContent);
  };
  return [
    h("ul", { class: "cards" }, sets.map((set) => h("li", { class: "card tile with-box" },
      h("input", { type: "checkbox", "aria-label": words.home.choose1(set.name), onchange: (event) => {
        if (event.target.checked) chosen.add(set.id);
        else chosen.delete(set.id);
        update();
      } }),
      h("a", { href: `#/ray-sets/${set.id}` }, h("strong", {}, set.name)),
      h("span", {}, set.header.format),
      h("span", { class: "hint" }, words.home.setFacts(count(set.header.ray_count), bytes(set.byte_count), when(set.created_ms)))))),
    h("p", { class: "hint" }, words.home.joinHint), join,
  ];
}
