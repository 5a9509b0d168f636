// The cases, one after another: each is a person who wants something. `node cases.mjs [WORDS]`.
import { mkdirSync, rmSync, writeFileSync } from "node:fs";
import { fileURLToPath } from "node:url";
import { launch } from "./browser.mjs";
import * as compare from "./compare.mjs";
import * as errors from "./errors.mjs";
import * as lists from "./lists.mjs";
import * as picture from "./picture.mjs";
import * as plane from "./plane.mjs";
import * as walks from "./walks.mjs";

const FAILED = fileURLToPath(new URL("../../target/portal/failed", import.meta.url));
const cases = Object.entries({ ...walks, ...picture, ...plane, ...compare, ...lists, ...errors }).filter(([name]) => !process.argv[2] || name.includes(process.argv[2]));
if (!cases.length) throw new Error("no case has such a name");

rmSync(FAILED, { recursive: true, force: true });
const browser = await launch();
const failed = [];
for (const [name, act] of cases) {
  const began = performance.now();
  const scene = { browser, pages: [], services: [] };
  try {
    await act(scene);
    console.log(`test ${name} ... ok, ${((performance.now() - began) / 1000).toFixed(1)} s`);
  } catch (error) {
    failed.push(name);
    console.log(`test ${name} ... FAILED\n${error.stack}`);
    mkdirSync(FAILED, { recursive: true });
    for (const [k, page] of scene.pages.entries()) {
      await page.screenshot({ path: `${FAILED}/${name}-${k}.png`, fullPage: true }).catch(() => {});
      console.log(`  page ${k} at ${page.url()}: ${page.seen.join("; ")}`);
    }
    for (const [k, service] of scene.services.entries()) writeFileSync(`${FAILED}/${name}-${k}.log`, service.log());
  }
  for (const page of scene.pages) await page.context().close().catch(() => {});
  for (const service of scene.services) await service.stop().catch(() => {});
}
await browser.close();
console.log(failed.length ? `FAILED: ${failed.join(", ")}` : `${cases.length} cases passed`);
process.exit(failed.length ? 1 : 0);
