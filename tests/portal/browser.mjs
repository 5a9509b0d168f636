// Chromium with everything watched: requests that leave the host, errors of pages, rules of accessibility.
import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { fileURLToPath } from "node:url";

const HOME = process.env.PORTAL ?? fileURLToPath(new URL("../../target/portal", import.meta.url));
const require = createRequire(`${HOME}/package.json`);
const { chromium } = require("playwright-core");
const AXE = readFileSync(require.resolve("axe-core/axe.min.js"), "utf8");
/** Minutes where a page needs seconds: a verdict does not hang on how busy the machine is. */
export const PATIENCE_MS = 180_000;

export function launch() {
  const flags = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync"];
  return chromium.launch({ executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium", args: flags });
}

/** A page of its own tab and profile; `seen` has what nobody wants. */
export async function open(browser, service, options = {}) {
  const context = await browser.newContext({ viewport: { width: 1280, height: 900 }, acceptDownloads: true, ...options });
  const page = await context.newPage();
  page.setDefaultTimeout(PATIENCE_MS);
  page.seen = [];
  page.on("pageerror", (error) => page.seen.push(`error in the page: ${error.stack}`));
  page.on("console", (message) => {
    if (/Content Security Policy|Refused to/.test(message.text())) page.seen.push(message.text());
  });
  page.on("request", (request) => {
    const { protocol, host } = new URL(request.url());
    if (["http:", "https:", "ws:", "wss:"].includes(protocol) && host !== new URL(service.url).host) page.seen.push(`asked elsewhere: ${request.url()}`);
  });
  await page.goto(`${service.url}/`);
  return page;
}

/** What the page did that nobody wants: nothing. */
export function calm(page) {
  assert.deepEqual(page.seen, []);
}

/** No rule of accessibility is broken on the page as it is. */
export async function accessible(page, what) {
  // axe is put into the page by the debugger, which the page's policy does not bind.
  const session = await page.context().newCDPSession(page);
  await session.send("Runtime.evaluate", { expression: AXE });
  const { violations, passes } = await page.evaluate(() => globalThis.axe.run(document, { resultTypes: ["violations"] }));
  const told = violations.map(({ id, help, nodes }) => `${id}: ${help}\n${nodes.map((node) => `    ${node.html.slice(0, 160)} ${node.failureSummary}`).join("\n")}`);
  assert.equal(told.length, 0, `${what}:\n${told.join("\n")}`);
  assert.ok(passes.length > 5, `${what}: only ${passes.length} rules were looked at`);
  await session.detach();
}

/** Nothing stands out of a narrow window. */
export async function fits(page, what) {
  const [wide, window] = await page.evaluate(() => [document.documentElement.scrollWidth, document.documentElement.clientWidth]);
  assert.ok(wide <= window, `${what}: ${wide} px in a window of ${window}`);
}

/** Moves the focus by Tab to what has this text or name. */
export async function tabTo(page, text) {
  for (let pressed = 0; pressed < 200; pressed += 1) {
    await page.keyboard.press("Tab");
    const focused = await page.evaluate(() => {
      const found = document.activeElement;
      // The page itself and places that scroll have all of their text as their own.
      if (!["A", "BUTTON", "INPUT", "SELECT", "CANVAS", "SUMMARY"].includes(found.tagName)) return "";
      return `${found.textContent} ${found.getAttribute("aria-label") ?? ""} ${found.labels?.[0]?.textContent ?? ""} ${found.className}`;
    });
    if (focused.includes(text)) return;
  }
  throw new Error(`Tab does not reach "${text}"`);
}

/** Drops files on the page's place for them, as a pointer would. */
export async function drop(page, files) {
  const sent = files.map(({ name, buffer }) => ({ name, text: buffer.toString("base64") }));
  const transfer = await page.evaluateHandle((list) => {
    const made = new DataTransfer();
    for (const { name, text } of list) made.items.add(new File([Uint8Array.from(atob(text), (sign) => sign.charCodeAt(0))], name));
    return made;
  }, sent);
  for (const type of ["dragenter", "dragover", "drop"]) await page.dispatchEvent(".drop", type, { dataTransfer: transfer });
}
