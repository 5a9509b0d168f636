// What can be taken away: every file with what it is for, new rays, and this page as commands.
import { ask, json, save } from "./api.js";
import { command, curl } from "./command.js";
import { announce, button, field, h, problem, put, select, table } from "./dom.js";
import { evaluations } from "./evaluation.js";
import { bytes, count, percent, whole } from "./numbers.js";
import { words } from "./words.js";

/** Answers that a parameter of the query is at fault for. An answer to HEAD has no body, and so no code. */
const PARAMETERS = [400, 422];
/** So long nobody has typed. */
const SOON_MS = 300;
const EXTENSIONS = { tm25: "tm25ray", zemax: "dat", lighttools: "ray" };

/** The files of a finished job. */
export async function downloads(job, title) {
  const { artifacts, zip } = await json(job.links.artifacts);
  const told = h("div", { class: "hint" });
  const take = (file, filename) => async () => {
    await save(file.href, filename, (come, length) => { told.textContent = words.downloads.come(bytes(come), length ? percent(come / length) : ""); })
      .catch((error) => put(told, problem(error)));
  };
  const ies = artifacts.filter(({ name }) => name.startsWith("ies/zone"));
  const shown = artifacts.filter((artifact) => !ies.includes(artifact));
  const row = (file) => [
    button(file.name, take(file, `${title} ${file.name}`.replaceAll("/", "-")), "link"),
    words.downloads.meaning(file.name), bytes(file.byte_count),
  ];
  const all = table(words.downloads.title, words.downloads.columns, [...shown, ...ies].map(row));
  // An evaluation is one file.
  if (!zip) return h("section", { class: "card", "aria-labelledby": "downloads-title" }, h("h2", { id: "downloads-title" }, words.downloads.title), told, all);
  return h("section", { class: "card", "aria-labelledby": "downloads-title" },
    h("h2", { id: "downloads-title" }, words.downloads.title),
    h("p", {}, button(words.downloads.zip(bytes(zip.byte_count)), take(zip, `${title}.zip`.replaceAll("/", "-")), "first")),
    told,
    h("details", {}, h("summary", {}, words.downloads.files(artifacts.length)), all),
    h("details", { class: "renderers" }, h("summary", {}, words.downloads.renderers),
      table(words.downloads.renderers, words.downloads.rendererColumns, words.downloads.rendererList.map(([renderer, called, meaning]) => [
        button(called, take({ href: adapter(job, renderer) }, `${title} ${renderer}.zip`.replaceAll("/", "-")), "link"), meaning,
      ])),
      h("p", { class: "hint" }, words.downloads.rendererHint)));
}

/** Where the files are that a renderer opens: they are made when they are asked for. */
function adapter(job, renderer) {
  return job.links.artifacts.replace(/\/artifacts$/, `/adapters/${renderer}`);
}

/** New rays: as many as wanted, in the format wanted. */
export function newRays(job) {
  const path = job.links.artifacts.replace(/\/artifacts$/, "/rays");
  const wanted = { count: "10000000", format: "tm25", seed: "1" };
  const size = h("div", { class: "hint" });
  let [latest, soon] = [0, null];
  const query = () => `${path}?count=${wanted.count}&seed=${wanted.seed}&format=${wanted.format}`;
  const isWhole = () => /^[1-9]\d{0,12}$/.test(wanted.count) && /^\d{1,20}$/.test(wanted.seed);
  const measure = async () => {
    latest += 1;
    const mine = latest;
    if (!isWhole()) return put(size, words.rays.wrong);
    try {
      const answer = await ask(query(), { method: "HEAD" });
      const length = Number(answer.headers.get("Content-Length"));
      if (mine === latest) put(size, words.rays.size(count(Number(wanted.count)), bytes(length)));
    } catch (error) {
      if (mine === latest) put(size, PARAMETERS.includes(error.status) ? words.rays.wrong : problem(error));
    }
  };
  const set = (name) => (value) => {
    const plain = value.replaceAll(/[\s\u202f_]/g, "");
    wanted[name] = name === "count" ? whole(plain) ?? plain : plain;
    clearTimeout(soon);
    soon = setTimeout(measure, SOON_MS);
  };
  const input = (name, label, hint) => field(label, h("input", { inputmode: "numeric", value: wanted[name], oninput: (event) => set(name)(event.target.value) }), hint);
  const draw = async () => {
    if (!isWhole()) return put(size, words.rays.wrong);
    announce(words.rays.begun);
    return save(query(), `rays-${wanted.count}.${EXTENSIONS[wanted.format]}`, (come, length) => put(size, words.downloads.come(bytes(come), length ? percent(come / length) : "")))
      .catch((error) => put(size, problem(error)));
  };
  measure();
  return h("section", { class: "card", "aria-labelledby": "rays-title" },
    h("h2", { id: "rays-title" }, words.rays.title), h("p", {}, words.rays.why),
    h("div", { class: "row" },
      input("count", words.rays.count, null),
      field(words.rays.format, select(words.rays.formats, wanted.format, set("format"))),
      input("seed", words.rays.seed, words.rays.seedHint)),
    size,
    button(words.rays.draw, draw, "first"));
}

/** What this page does, for scripts. */
export function commands(job) {
  const lines = [
    [words.commands.job, curl(job.links.self)],
    [words.commands.zip, curl(job.links.zip, { flags: "-O" })],
    [words.commands.artifacts, curl(job.links.artifacts)],
    [words.commands.rays, curl(`${job.links.artifacts.replace(/\/artifacts$/, "/rays")}?count=10000000&seed=1&format=tm25`, { flags: "-C - -o new.tm25ray" })],
    [words.commands.adapter, curl(adapter(job, "blender"), { flags: "-o blender.zip" })],
    [words.commands.intensity, curl(evaluations(job), { json: { view: { grid: { c_step_deg: 15, gamma_step_deg: 5 } }, format: "csv" } })],
    [words.commands.again, curl("v1/jobs", { json: request(job) })],
  ];
  return h("section", { class: "card", "aria-labelledby": "commands-title" },
    h("h2", { id: "commands-title" }, words.commands.title),
    h("details", {}, h("summary", {}, words.commands.show), lines.map(([text, line]) => command(text, line).element)));
}

/** The body of the request that makes an equal job: without what is not said. */
function request({ channels, options, total }) {
  const said = (value) => {
    if (Array.isArray(value)) return value.map(said);
    if (value === null || typeof value !== "object") return value;
    const members = Object.entries(value).map(([name, member]) => [name, said(member)]);
    return Object.fromEntries(members.filter(([, member]) => member !== null && !(typeof member === "object" && !Array.isArray(member) && !Object.keys(member).length)));
  };
  return said({ channels, options, total });
}
