// Which model is looked at beside this one: a list of the recent ones.
import { json } from "./api.js";
import { button, h, problem, put } from "./dom.js";
import { nameOf, namesOf } from "./home.js";
import { when } from "./numbers.js";
import { words } from "./words.js";

const MOST = 50;

export async function chooseOther(job) {
  const list = h("div", {}, h("p", {}, words.loading));
  const dialog = h("dialog", { "aria-label": words.compare.title, onclose: () => dialog.remove() },
    h("h2", {}, words.compare.title), h("p", { class: "hint" }, words.compare.why), list,
    h("div", { class: "row end" }, button(words.compare.close, () => dialog.close())));
  document.body.append(dialog);
  dialog.showModal();
  try {
    const { jobs } = await json(`v1/jobs?state=succeeded&evaluation=false&limit=${MOST}`);
    const others = jobs.filter(({ id }) => id !== job.id);
    const names = await namesOf(others);
    put(list, others.length
      ? h("ul", { class: "plain choices" }, others.map((other) => h("li", {}, h("a", { href: `#/compare/${job.id},${other.id}`, onclick: () => dialog.close() },
        nameOf(other, names)), " ", h("span", { class: "hint" }, when(other.finished_ms ?? other.created_ms)))))
      : h("p", {}, words.compare.none));
  } catch (error) {
    put(list, problem(error));
  }
}
