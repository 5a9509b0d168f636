// API keys: asked for where the service asks for them, kept for the tab and nowhere else.
import { announce, field, h } from "./dom.js";
import { words } from "./words.js";

const PLACE = "lampwright.key";
let asking = null;

/** The key of this tab; null where none was needed yet. */
export function key() {
  return sessionStorage.getItem(PLACE);
}

export function forget() {
  sessionStorage.removeItem(PLACE);
}

/** Headers that carry the key. */
export function authorization() {
  return key() ? { Authorization: `Bearer ${key()}` } : {};
}

/** Asks for a key, once for all requests that wait for one; resolves to whether one was given. */
export function askForKey(wasWrong) {
  asking ??= new Promise((resolve) => {
    const input = h("input", { type: "password", autocomplete: "off", required: true, spellcheck: "false" });
    const wrong = wasWrong ? h("p", { class: "problem", role: "alert" }, words.key.wrong) : null;
    const dialog = h("dialog", { "aria-label": words.key.title, onclose: () => finish(dialog.returnValue === "given") },
      h("form", { onsubmit: (event) => { event.preventDefault(); dialog.close("given"); } },
        h("h2", {}, words.key.title), h("p", {}, words.key.why), wrong,
        field(words.key.label, input, words.key.hint),
        h("div", { class: "row end" },
          h("button", { type: "button", onclick: () => dialog.close("left") }, words.key.later),
          h("button", { class: "first" }, words.key.use))));
    const finish = (given) => {
      if (given) sessionStorage.setItem(PLACE, input.value.trim());
      dialog.remove();
      asking = null;
      resolve(given);
    };
    document.body.append(dialog);
    dialog.showModal();
    announce(wasWrong ? words.key.wrong : words.key.why);
  });
  return asking;
}
