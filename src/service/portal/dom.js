// Elements, announcements and dialogs: the only module that makes elements, so that no text ever becomes markup.
import { typed } from "./numbers.js";
import { words } from "./words.js";

const SVG = "http://www.w3.org/2000/svg";

/** An HTML element: `on…` are listeners, other values attributes (true: present, false, null: absent). */
export function h(tag, attributes, ...children) {
  return fill(document.createElement(tag), attributes, children);
}

/** An SVG element. */
export function s(tag, attributes, ...children) {
  return fill(document.createElementNS(SVG, tag), attributes, children);
}

function fill(element, attributes, children) {
  for (const [name, value] of Object.entries(attributes ?? {})) {
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (name === "value" && "value" in element) element.value = value;
    else if (value === true) element.setAttribute(name, "");
    else if (value !== false && value !== null && value !== undefined) element.setAttribute(name, value);
  }
  element.append(...children.flat(3).filter((child) => child !== null && child !== undefined && child !== false));
  return element;
}

/** Puts `children` in the place of what an element holds. */
export function put(element, ...children) {
  element.replaceChildren(...children.flat(3).filter((child) => child !== null && child !== undefined && child !== false));
  return element;
}

/** Says a sentence to who cannot see the page. */
export function announce(text) {
  const region = document.getElementById("said");
  region.textContent = "";
  // A region that gets the same text again is silent: the text comes after the change to nothing was seen.
  setTimeout(() => { region.textContent = text; }, 50);
}

let lastName = 0;

/** A name for an element that a label or a description refers to. */
export function name(prefix) {
  lastName += 1;
  return `${prefix}-${lastName}`;
}

/** A label above a control, with an explanation below where there is one. */
export function field(label, control, hint) {
  control.id ||= name("field");
  const told = hint ? h("p", { class: "hint", id: `${control.id}-hint` }, hint) : null;
  if (told) control.setAttribute("aria-describedby", told.id);
  return h("div", { class: "field" }, h("label", { for: control.id }, label), control, told);
}

/** A choice of one of `options`: pairs of value and text. */
export function select(options, value, onchange) {
  const made = h("select", { onchange: (event) => onchange?.(event.target.value) },
    options.map(([key, text]) => h("option", { value: key, selected: key === value }, text)));
  made.value = value;
  return made;
}

/** A place for a number above 0; what is none is marked as wrong. Disabled until it is asked for. */
export function amount(onchange) {
  return h("input", { inputmode: "decimal", autocomplete: "off", disabled: true, oninput: ({ target }) => {
    target.setAttribute("aria-invalid", target.value !== "" && !(typed(target.value) > 0));
    onchange(target.value);
  } });
}

export function button(text, onclick, kind = "") {
  return h("button", { type: "button", class: kind, onclick }, text);
}

/** What is wrong and what to do: of a request, a file or a job. */
export function problem(found, ...more) {
  return h("div", { class: "problem", role: "alert" },
    h("p", { class: "title" }, found.title || words.problem.title),
    h("p", {}, found.detail || found.message || String(found)),
    found.remedy ? h("p", {}, h("strong", {}, words.problem.remedy), " ", found.remedy) : null,
    found.code ? h("p", { class: "hint" }, words.problem.code(found.code, found.at)) : null,
    more);
}

/** Asks before something is deleted; resolves to whether it was meant. */
export function confirmed(title, text, yes) {
  return new Promise((resolve) => {
    const dialog = h("dialog", { "aria-label": title, onclose: () => { dialog.remove(); resolve(dialog.returnValue === "yes"); } },
      h("h2", {}, title), h("p", {}, text),
      h("div", { class: "row end" },
        button(words.no, () => dialog.close("no")),
        button(yes, () => dialog.close("yes"), "danger")));
    document.body.append(dialog);
    dialog.showModal();
  });
}

/** A bar that fills from 0 to 1, with a text beside it. */
export function bar(label) {
  const progress = h("progress", { max: 1, value: 0, "aria-label": label });
  return {
    element: progress,
    set: (fraction) => {
      if (fraction === null) progress.removeAttribute("value");
      else progress.value = fraction;
    },
  };
}

/** A table of texts; cells of the first column are headings. */
export function table(caption, head, rows) {
  return h("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": words.tableOf(caption) },
    h("table", {},
      h("caption", { class: "unseen" }, caption),
      h("thead", {}, h("tr", {}, head.map((text) => h("th", { scope: "col" }, text)))),
      h("tbody", {}, rows.map((row) => h("tr", {}, row.map((cell, column) =>
        column === 0 ? h("th", { scope: "row" }, cell) : h("td", {}, cell)))))));
}
