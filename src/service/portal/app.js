// The pages by their addresses: #/ , #/ray-sets/ID[,ID..], #/jobs/ID, #/compare/ID,ID. Each page gets an element and a signal that says it was left.
import { address } from "./api.js";
import { comparePage } from "./compare.js";
import { announce, button, h, problem, put } from "./dom.js";
import { homePage } from "./home.js";
import { jobPage } from "./job.js";
import { forget, key } from "./keys.js";
import { sourcePage } from "./source.js";
import { goOn } from "./transfers.js";
import { words } from "./words.js";

const ROUTES = [
  [/^#?\/?$/, (page) => homePage(page)],
  [/^#\/ray-sets\/([\w,-]+)$/, (page, signal, ids) => sourcePage(page, ids.split(","))],
  [/^#\/jobs\/([\w-]+)$/, (page, signal, id) => jobPage(page, id, signal)],
  [/^#\/compare\/([\w-]+),([\w-]+)$/, (page, signal, ...ids) => comparePage(page, ids, signal)],
];

let left = new AbortController();
let isFirst = true;

async function show() {
  left.abort();
  left = new AbortController();
  const { signal } = left;
  const main = document.getElementById("main");
  const page = h("div", { class: "page" });
  put(main, page);
  heading();
  const [route, open] = ROUTES.find(([pattern]) => pattern.test(location.hash)) ?? [];
  // The first page begins at the top; later ones take the focus, so that who cannot see hears of them.
  if (!isFirst) {
    scrollTo(0, 0);
    main.focus({ preventScroll: true });
  }
  isFirst = false;
  try {
    if (!open) throw Object.assign(new Error(words.nothing), { title: words.nothingTitle });
    await open(page, signal, ...route.exec(location.hash).slice(1));
  } catch (error) {
    if (signal.aborted) return;
    console.info(error);
    put(page, h("h1", {}, words.problem.title), problem(error), h("p", {}, button(words.problem.again, show, "first"), " ", h("a", { href: "#/" }, words.home.short)));
  }
}

function heading() {
  const isHome = !/^#\/./.test(location.hash);
  put(document.getElementById("top"),
    h("a", { class: "brand", href: "#/", "aria-current": isHome ? "page" : null }, h("span", { class: "logo", "aria-hidden": "true" }), words.name),
    h("nav", { "aria-label": words.navigation },
      h("a", { href: "#/" }, words.home.short),
      h("a", { href: address("docs/") }, words.interface),
      key() ? button(words.key.forget, () => { forget(); announce(words.key.forgotten); show(); }, "link") : null));
  put(document.getElementById("bottom"), h("p", {}, words.foot));
}

addEventListener("hashchange", show);
// Files that are dropped beside the place for them would replace the page.
for (const name of ["dragover", "drop"]) addEventListener(name, (event) => event.preventDefault());
show();
goOn();
