// Whether to trust a model: its errors beside those of its own rays, what was chosen and why, and every notice.
import { h, s, table } from "./dom.js";
import { count, percent, significant } from "./numbers.js";
import { words } from "./words.js";

/** The verdict in a few words, and in a sentence; null without a comparison. */
export function verdict(report) {
  const figures = report.quality?.figures ?? [];
  const main = figures.filter(({ view }) => view === "plane" || view === "far_field");
  if (!main.length) return null;
  const worst = main.reduce((a, b) => (error(b) > error(a) ? b : a));
  const better = main.filter((figure) => error(figure) < figure.rays_error).length;
  const level = error(worst) <= 0.05 ? "good" : error(worst) <= 0.15 ? "fair" : "poor";
  return { level, short: words.quality.levels[level], worst: words.quality.worst(words.quality.levels[level], shown(worst), view(worst)), text: words.quality.sentence(shown(worst), view(worst), better, main.length) };
}

/** What is known of an error: below the noise it cannot be told from nothing, and is at most the noise. README.txt and the plots say so too. */
function error(figure) {
  return Math.max(figure.model_error, figure.noise);
}

/** The error as text. */
function shown(figure) {
  return figure.model_error < figure.noise ? words.quality.hidden(percent(figure.noise)) : percent(figure.model_error);
}

function view(figure) {
  if (figure.view === "plane" || figure.view === "spectral_plane") return words.quality.views[figure.view](significant(figure.sizes, 2));
  if (figure.view === "seen") return words.quality.views.seen(figure.angle_deg === null ? "" : significant(figure.angle_deg, 3));
  return words.quality.views[figure.view] ?? figure.view;
}

export function quality(report, notices) {
  const told = verdict(report);
  const { quality: found, emission, balance } = report;
  return h("section", { id: "quality", class: "card", tabindex: -1, "aria-labelledby": "quality-title" },
    h("h2", { id: "quality-title" }, words.quality.title),
    told ? h("p", { class: `verdict ${told.level}` }, h("strong", {}, told.short), " ", told.text) : h("p", { class: "verdict" }, words.quality.none),
    found ? [
      h("p", { class: "hint" }, words.quality.how(count(found.training_rays), count(found.judging_rays))),
      figures(found.figures),
    ] : null,
    balanced(balance),
    emission ? chosen(emission) : null,
    h("h3", {}, words.quality.notices),
    notices.length ? h("ul", { class: "notices" }, notices.map(notice)) : h("p", {}, words.quality.noNotices));
}

/** Errors as bars and as a table: the model's and its rays' on one scale. */
function figures(list) {
  const most = Math.max(...list.map((figure) => Math.max(figure.rays_error, error(figure))), 1e-9);
  const drawn = (figure) => s("svg", { viewBox: "0 0 200 18", class: "bars", "aria-hidden": "true" },
    s("rect", { x: 0, y: 1, height: 7, width: Math.max(1, (200 * error(figure)) / most), class: "ours" }),
    s("rect", { x: 0, y: 10, height: 7, width: Math.max(1, (200 * figure.rays_error) / most), class: "rays" }));
  return table(words.quality.table, words.quality.columns,
    list.map((figure) => [view(figure), figure.model_error < figure.noise ? words.quality.below : percent(figure.model_error), percent(figure.rays_error), percent(figure.noise), drawn(figure)]));
}

function balanced(balance) {
  const part = (share) => (balance.incoming.rays ? share.rays / balance.incoming.rays : 0);
  const lost = balance.rejected.rays;
  return h("p", {}, words.quality.balance(count(balance.incoming.rays), percent(part(balance.hit)), percent(part(balance.snapped)), count(lost)));
}

/** Where the light was put, of which candidates. */
function chosen(emission) {
  const surface = (candidate) => words.quality.surfaces[candidate.surface] ?? candidate.surface;
  const taken = emission.candidates[emission.chosen];
  return [
    h("h3", {}, words.quality.chosen),
    h("p", {}, words.quality.put(surface(taken), emission.candidates.length, count(emission.compared_rays))),
    emission.candidates.length > 1 ? h("details", {}, h("summary", {}, words.quality.candidates),
      table(words.quality.candidates, words.quality.candidateColumns, emission.candidates.map((candidate, k) => [
        `${surface(candidate)}${k === emission.chosen ? ` (${words.quality.taken})` : ""}`,
        significant(candidate.log_radiance, 5),
        candidate.gain === null ? "–" : `${significant(candidate.gain, 3)} ± ${significant(candidate.gain_error, 2)}`,
      ]))) : null,
  ];
}

/** A notice: of a job, an inspection or an estimate. */
export function notice({ channel, message, count: times, code }) {
  return h("li", {}, channel ? h("strong", {}, `${channel}: `) : null, message, " ",
    h("span", { class: "hint" }, times > 1 ? `${words.quality.times(count(times))} ` : "", h("code", {}, code)));
}
