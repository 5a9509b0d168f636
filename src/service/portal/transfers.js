// Files on their way, as a list that stays while pages change: progress, what went wrong, and what a text's columns hold.
import { announce, button, h, name, problem, put } from "./dom.js";
import { bytes, percent, seconds } from "./numbers.js";
import { columnsForm } from "./columns.js";
import { interrupted, Transfer } from "./upload.js";
import { words } from "./words.js";

const list = h("ul", { class: "transfers", "aria-label": words.transfers.title });
const all = new Set();
let whenTaken = () => {};
/** So many of the ray files of one packed file are named at once. */
const FIRST = 5;
const ENDED = ["taken", "refused", "cancelled", "unknown", "elsewhere"];

/** The list's element; `ontaken(raySets)` is called when all files that were sent together are there. */
export function transfers(ontaken) {
  whenTaken = ontaken;
  return list;
}

/** Goes on with what a reload interrupted. */
export async function goOn() {
  const left = await interrupted();
  if (left.length) begin(left);
}

/** Sends files; once all have ended, the ray sets they became are told together. */
export function send(files, declared = {}) {
  begin([...files].map((file) => new Transfer(file, declared)));
}

function begin(together) {
  const settle = () => {
    if (together.some(({ state }) => !ENDED.includes(state))) return;
    const raySets = together.flatMap((transfer) => transfer.raySets);
    if (list.isConnected && raySets.length && !together.some(({ state }) => ["refused", "unknown"].includes(state))) whenTaken(raySets);
  };
  for (const transfer of together) {
    all.add(transfer);
    list.append(row(transfer));
    transfer.onchange(({ state }) => { if (ENDED.includes(state)) settle(); });
    transfer.run();
  }
}

function row(transfer) {
  const progress = h("progress", { max: 1, value: 0, "aria-label": words.transfers.progress(transfer.file.name) });
  const told = h("p", { class: "hint" });
  const more = h("div", {});
  const actions = h("div", { class: "row" });
  const item = h("li", { class: "transfer card" },
    h("div", { class: "row between" }, h("h2", {}, transfer.file.name), actions), progress, told, more);
  const remove = () => { all.delete(transfer); item.remove(); };
  let last = null;
  const update = () => {
    const { state, sent, file, rate, raySets } = transfer;
    progress.value = file.size ? sent / file.size : 1;
    told.textContent = words.transfers.states[state]({
      sent: bytes(sent), size: bytes(file.size), percent: percent(file.size ? sent / file.size : 1),
      left: rate ? seconds((file.size - sent) / rate) : null, count: raySets.length, isQuestion: asksForColumns(transfer),
    });
    if (state === last) return;
    last = state;
    progress.hidden = ENDED.includes(state);
    if (state === "reading") progress.removeAttribute("value");
    if (state !== "sending") announce(`${file.name}: ${told.textContent}`);
    put(actions, act(transfer, remove));
    put(more, state === "refused" ? refused(transfer, remove) : state === "taken" ? taken(transfer) : null);
  };
  transfer.onchange(update);
  update();
  return item;
}

function act(transfer, remove) {
  const stop = button(words.transfers.cancel, () => { transfer.cancel(); remove(); });
  switch (transfer.state) {
    case "sending": case "lost": case "waiting":
      return [button(words.transfers.pause, () => transfer.pause()), stop];
    case "paused":
      return [button(words.transfers.resume, () => transfer.run(), "first"), stop];
    case "reading":
      return [];
    case "unknown":
      return [button(words.transfers.sendAgain, () => transfer.sendAgain(), "first"), button(words.transfers.remove, remove)];
    default:
      return [button(words.transfers.remove, remove)];
  }
}

/** A text whose columns do not say what they hold. */
function asksForColumns({ problem: found }) {
  return Boolean(found?.code?.startsWith("columns.")) && found.code !== "columns.no_rows";
}

/** Why a file was refused; where the columns of a text are not known, the question. */
function refused(transfer, remove) {
  const { problem: found, file } = transfer;
  if (!asksForColumns(transfer)) return problem(found);
  const form = h("div", { id: name("columns") }, h("p", {}, words.loading));
  columnsForm(file, found, (columns) => {
    remove();
    send([file], { ...transfer.declared, columns: columns.join(",") });
  }).then((made) => put(form, made));
  return form;
}

function taken(transfer) {
  const one = (id, k) => h("li", {}, h("a", { href: `#/ray-sets/${id}` }, transfer.raySets.length > 1 ? words.transfers.openOne(k + 1) : words.transfers.open));
  const list = h("ul", { class: "plain" }, transfer.raySets.slice(0, FIRST).map(one));
  const rest = transfer.raySets.slice(FIRST);
  const all = button(words.transfers.showAll(transfer.raySets.length), () => {
    list.append(...rest.map((id, k) => one(id, FIRST + k)));
    list.children[FIRST].querySelector("a").focus();
    all.remove();
  });
  return [
    list, rest.length ? all : null,
    transfer.leftOut.length ? h("details", {}, h("summary", {}, words.transfers.leftOut(transfer.leftOut.length)),
      h("ul", {}, transfer.leftOut.map(({ name: file, detail }) => h("li", {}, h("strong", {}, file), " ", detail)))) : null,
  ];
}
