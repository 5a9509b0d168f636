// How fast the lamp turns: frames a second and CPU time a frame of the built-in sample's model in a canvas of 800 x 600 pixels, drawn by
// SwiftShader. `node tests/portal/frames.mjs [SECONDS [TURNS [FOLDER..]]]`: the portal in the binary, or the portals in these folders in
// turns, so that all of them meet the same load. README.md says what the numbers are.
import { existsSync, readFileSync } from "node:fs";
import { basename, join } from "node:path";
import { launch, open } from "./browser.mjs";
import { Service } from "./service.mjs";

const [WIDE, TALL] = [800, 600];
/** "empty" only clears the canvas: what the browser itself needs to put a changed picture on the screen. */
const MODES = (process.env.MODES ?? "empty,seen").split(",");
const [seconds = "6", turns = "3", ...folders] = process.argv.slice(2);

/** Turns the lamp for a while, as a hand would: each picture is asked for once the one before is shown. */
function turned(page, mode, ms) {
  return page.evaluate(async ([shown, duration]) => {
    const { view } = document.querySelector("canvas.lamp");
    if (shown !== "empty") view.become({ mode: shown });
    const next = () => new Promise((resolve) => { requestAnimationFrame(resolve); });
    const frames = [];
    const { picture } = view;
    const empty = () => {
      const { gl } = picture;
      gl.bindFramebuffer(gl.FRAMEBUFFER, null);
      gl.clearColor(Math.random(), 0, 0, 1);
      gl.clear(gl.COLOR_BUFFER_BIT);
      picture.finish();
    };
    const render = shown === "empty" ? empty : view.render.bind(view);
    view.render = () => {
      const began = performance.now();
      render();
      frames.push({ at: began, took: performance.now() - began, size: view.picture.size.join(" x ") });
    };
    const began = performance.now();
    while (performance.now() - began < duration) {
      view.camera.turn(2, 0.3);
      view.moved();
      await next();
    }
    const ended = performance.now();
    delete view.render;
    const took = frames.map((frame) => frame.took).sort((a, b) => a - b);
    return { count: frames.length, seconds: (ended - began) / 1000, median: took[took.length >> 1], size: frames.at(-1).size };
  }, [mode, ms]);
}

async function cpuSeconds(session) {
  const { processInfo } = await session.send("SystemInfo.getProcessInfo");
  const of = (type) => processInfo.filter((one) => one.type === type).reduce((sum, { cpuTime }) => sum + cpuTime, 0);
  return { gpu: of("GPU"), page: of("renderer"), all: processInfo.reduce((sum, { cpuTime }) => sum + cpuTime, 0) };
}

async function measured(service, folder, job) {
  const browser = await launch();
  const page = await open(browser, service);
  // A policy that forbids scripts from elsewhere does not forbid ours: they come under the same addresses.
  if (folder) {
    await page.route("**/portal/*/*", (route) => {
      const path = join(folder, basename(new URL(route.request().url()).pathname));
      return existsSync(path) ? route.fulfill({ path, contentType: path.endsWith(".css") ? "text/css" : "text/javascript" }) : route.continue();
    });
  }
  await page.goto(`${service.url}/#/jobs/${job}`);
  if (folder) await page.reload();
  await page.locator("canvas.lamp").waitFor();
  await page.addStyleTag({ content: `canvas.lamp { width: ${WIDE}px !important; height: ${TALL}px !important; max-width: none !important }` }).catch(() => {});
  await page.evaluate(([wide, tall]) => {
    const { style } = document.querySelector("canvas.lamp");
    for (const [name, px] of [["width", wide], ["height", tall]]) style.setProperty(name, `${px}px`, "important");
    for (const name of ["max-width", "max-height"]) style.setProperty(name, "none", "important");
  }, [WIDE, TALL]);
  const session = await browser.newBrowserCDPSession();
  const found = [];
  for (const mode of MODES) {
    await turned(page, mode, 1500);
    const before = await cpuSeconds(session);
    const { count, seconds: passed, median, size } = await turned(page, mode, 1000 * Number(seconds));
    const after = await cpuSeconds(session);
    const ms = (kind) => (1000 * (after[kind] - before[kind])) / count;
    found.push({ mode, rate: count / passed, median, size, gpu: ms("gpu"), page: ms("page"), all: ms("all") });
  }
  await browser.close();
  return found;
}

const service = await Service.start({ sample: true });
try {
  const [{ id }] = (await service.ask("/v1/jobs")).jobs;
  let job = await service.ask(`/v1/jobs/${id}`);
  while (job.state === "queued" || job.state === "running") job = await service.ask(`/v1/jobs/${id}?wait=30`);
  for (let turn = 0; turn < Number(turns); turn += 1) {
    for (const folder of folders.length ? folders : [null]) {
      for (const { mode, rate, median, size, gpu, page, all } of await measured(service, folder, id)) {
        const load = readFileSync("/proc/loadavg", "utf8").split(" ")[0];
        console.log(`${folder ?? "binary"} ${mode}: ${rate.toFixed(1)} frames/s at ${size}, ${median.toFixed(1)} ms a picture; CPU a frame ${all.toFixed(1)} ms: ${gpu.toFixed(1)} drawing, ${page.toFixed(1)} page; load ${load}`);
      }
    }
  }
} finally {
  await service.stop();
}
