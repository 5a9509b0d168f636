// A job while it waits and runs, live; what became of it; once it has succeeded, its model.
import { follow, json } from "./api.js";
import { announce, bar, button, h, problem, put } from "./dom.js";
import { downloads } from "./downloads.js";
import { nameOf } from "./home.js";
import { modelPage, removal } from "./model.js";
import { percent } from "./numbers.js";
import { words } from "./words.js";

export async function jobPage(page, id, signal) {
  put(page, h("p", { class: "card" }, words.loading));
  const job = await json(`v1/jobs/${encodeURIComponent(id)}`);
  if (job.state === "succeeded") return job.evaluation ? evaluated(page, job) : modelPage(page, job, signal);
  if (job.state !== "queued" && job.state !== "running") return ended(page, job);
  return progress(page, job, signal);
}

async function progress(page, job, signal) {
  const sets = await Promise.all(job.channels.map(({ ray_set: set }) => json(`v1/ray-sets/${set}`).catch(() => ({}))));
  const name = nameOf(job, new Map(sets.map((set) => [set.id, set.name])));
  document.title = words.title(name);
  const whole = bar(words.job.whole);
  const told = h("p", { class: "big" });
  const lost = h("p", { class: "problem", role: "alert", hidden: true }, words.job.lost);
  const stages = h("ol", { class: "stages" }, job.stages.map((stage) => h("li", { "data-stage": stage.name }, h("span", {}, words.job.stages[stage.name] ?? stage.name), h("span", { class: "done" }))));
  const failed = h("div", {});
  const cancel = button(words.job.cancel, async () => {
    cancel.disabled = true;
    await json(job.links.cancel, { method: "POST" }).catch((error) => { cancel.disabled = false; put(failed, problem(error)); });
    announce(words.job.cancelling);
  }, "danger");
  put(page, h("h1", {}, name), h("section", { class: "card job", "aria-label": words.job.title }, told, whole.element, stages, lost, failed, h("div", { class: "row" }, cancel)));
  let spoken = null;
  const show = ({ state, stage, fraction, progress: done, queue_position: place }) => {
    whole.set(state === "queued" ? 0 : done);
    const text = state === "queued" ? words.job.queued(place) : words.job.running(words.job.stages[stage] ?? "", percent(done));
    told.textContent = text;
    document.title = words.title(`${percent(done)} ${name}`);
    let isBefore = stage !== null;
    for (const item of stages.children) {
      const isNow = item.dataset.stage === stage;
      if (isNow) isBefore = false;
      item.className = isNow ? "now" : isBefore ? "past" : "";
      if (isNow) item.setAttribute("aria-current", "step");
      else item.removeAttribute("aria-current");
      item.lastChild.textContent = isNow ? percent(fraction) : isBefore ? "✓" : "";
    }
    if (spoken !== stage) {
      spoken = stage;
      announce(text);
    }
  };
  const current = job.stages.find(({ name: stage }) => stage === job.stage);
  show({ ...job, fraction: current?.progress ?? 0 });
  await follow(`${job.links.self}/events`, signal, (event, data) => {
    if (event === "progress") show(data);
  }, (isLost) => { lost.hidden = !isLost; });
  if (signal.aborted) return;
  const last = await json(job.links.self);
  announce(last.evaluation && last.state === "succeeded" ? words.job.evaluated : words.job.ended[last.state] ?? "");
  if (last.state === "succeeded") await (last.evaluation ? evaluated(page, last) : modelPage(page, last, signal));
  else await ended(page, last);
}

/** An evaluation that has succeeded: its file. */
async function evaluated(page, job) {
  document.title = words.title(words.job.evaluation);
  put(page, h("div", { class: "row between" }, h("h1", {}, words.job.evaluated),
    h("div", { class: "row" }, h("a", { class: "button", href: `#/jobs/${job.evaluation.job}` }, words.job.itsModel), removal(job))),
    await downloads(job, words.job.evaluation));
}

/** Failed or cancelled: why, and what to do. */
async function ended(page, job) {
  document.title = words.title(words.states[job.state]);
  const ids = job.channels.map(({ ray_set: id }) => id).join(",");
  put(page, h("h1", {}, words.job.ended[job.state]),
    h("section", { class: "card", "aria-label": words.job.title },
      job.problem ? problem(job.problem) : h("p", {}, job.evaluation ? words.job.evaluationCancelled : words.job.cancelledWhy),
      h("div", { class: "row" }, job.evaluation
        ? h("a", { class: "button first", href: `#/jobs/${job.evaluation.job}` }, words.job.itsModel)
        : h("a", { class: "button first", href: `#/ray-sets/${ids}` }, words.job.again), removal(job))));
}
