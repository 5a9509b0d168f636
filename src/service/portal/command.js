// The same by command: a request as a line for a shell, and a button that copies it.
import { address } from "./api.js";
import { announce, button, h } from "./dom.js";
import { key } from "./keys.js";
import { words } from "./words.js";

/** A request as a curl command; `json` is sent. A key is named, not told. */
export function curl(path, { flags = "", json = null } = {}) {
  const auth = key() ? " -H \"Authorization: Bearer $KEY\"" : "";
  const body = json === null ? "" : ` -H 'Content-Type: application/json' -d '${JSON.stringify(json).replaceAll("'", "'\\''")}'`;
  return `curl${auth}${flags ? ` ${flags}` : ""} '${address(path)}'${body}`;
}

/** A command with what it is for; `set(line)` changes it. */
export function command(text, line) {
  const shown = h("pre", { tabindex: 0, "aria-label": text }, line);
  const copy = () => navigator.clipboard.writeText(shown.textContent).then(() => announce(words.commands.copied), () => announce(words.commands.notCopied));
  return {
    element: h("div", { class: "command" }, h("p", {}, text), shown, navigator.clipboard ? button(words.commands.copy, copy) : null),
    set: (changed) => { shown.textContent = changed; },
  };
}
