// What the columns of a text hold: its first rows as they are, a guess that says why, and a choice for each column.
import { h, name, problem } from "./dom.js";
import { words } from "./words.js";

const ROWS = 6;
const LOOKED_AT_BYTES = 1 << 14;
const PLACE = ["x", "y", "z", "l", "m", "n"];

/** Asks; `done(columns)` gets a name for each column. */
export async function columnsForm(file, found, done) {
  const rows = await firstRows(file);
  const width = rows[0]?.length ?? 0;
  if (!width) return problem(found);
  const guess = guessed(rows);
  const choices = guess.map((value, column) => h("select", { "aria-label": words.columns.of(column + 1) },
    words.columns.kinds.map(([key, text]) => h("option", { value: key, selected: key === value }, text))));
  choices.forEach((choice, column) => { choice.value = guess[column]; });
  const title = name("columns-title");
  return h("form", { class: "columns-form", "aria-labelledby": title, onsubmit: (event) => { event.preventDefault(); done(choices.map((choice) => choice.value)); } },
    h("h3", { id: title }, words.columns.title), h("p", {}, found.detail), h("p", { class: "hint" }, words.columns.guess),
    h("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": words.columns.rows },
      h("table", {}, h("caption", { class: "unseen" }, words.columns.rows),
        h("thead", {}, h("tr", {}, choices.map((choice) => h("th", { scope: "col" }, choice)))),
        h("tbody", {}, rows.slice(0, ROWS).map((row) => h("tr", {}, row.map((cell) => h("td", {}, cell))))))),
    h("button", { class: "first" }, words.columns.send));
}

/** The first rows of numbers, all of one width. */
async function firstRows(file) {
  const text = await file.slice(0, LOOKED_AT_BYTES).text();
  const lines = text.split(/\r?\n/).slice(0, -1).map((line) => line.trim().split(/[\s,;]+/).filter(Boolean));
  const numbers = lines.filter((cells) => cells.length >= 6 && cells.every((cell) => Number.isFinite(Number(cell))));
  const width = numbers.at(-1)?.length;
  return numbers.filter((cells) => cells.length === width);
}

/** Position and direction first, as nearly all programs write; a wavelength where all values are light's; flux where nothing else is. */
function guessed(rows) {
  const guess = rows[0].map((_, column) => PLACE[column] ?? "ignored");
  let hasFlux = false;
  for (let column = 6; column < guess.length; column += 1) {
    const values = rows.map((row) => Number(row[column]));
    const within = (low, high) => values.every((value) => value >= low && value <= high);
    if (within(300, 1100)) guess[column] = "wavelength_nm";
    else if (within(0.3, 1.1) && hasFlux) guess[column] = "wavelength_um";
    else if (!hasFlux) {
      guess[column] = "flux";
      hasFlux = true;
    }
  }
  return guess;
}
