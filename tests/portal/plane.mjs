// Light on a plane: its values against a closed form, the slider, the cursor, files, the command, and a service that is busy.
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { readFileSync } from "node:fs";
import { accessible, calm, fits, tabTo } from "./browser.mjs";
import { evaluated, modelOf } from "./models.mjs";
import { sample } from "./service.mjs";

/**
 * Illuminance by an even Lambertian square of side 1 mm and exitance `m`, lm/mm², on its axis at the distance `d`, mm: lx. (The
 * configuration factor of a rectangle to a parallel element on the normal through its corner, four times.)
 */
function onAxis(m, d) {
  const x = 0.5 / d;
  const root = Math.sqrt(1 + x * x);
  return 1e6 * m * (4 / Math.PI) * (x / root) * Math.atan(x / root);
}

const card = (page) => page.locator(".plane-card");

/**
 * Waits until the picture is as fine as the service makes it: on a busy machine that may be less fine, and what took longer than an answer may
 * take is tried again, as the page says.
 */
async function fine(page) {
  for (;;) {
    const state = await page.waitForFunction(() => {
      const found = document.querySelector(".plane-card");
      if (!found || found.hasAttribute("aria-busy")) return false;
      if (found.textContent.includes("evaluation.too_long")) return "late";
      return found.querySelector("canvas.plane").width >= 24 && /points, each/.test(found.querySelector("[role=status]").textContent) && "fine";
    });
    if ((await state.jsonValue()) === "fine") return;
    await card(page).getByRole("button", { name: "Try again" }).click();
  }
}

/** A number with its prefix, as lx or W/m². */
function number(text) {
  const [, digits, prefix] = /^([\d.\u202f]+) ([GMkmµ]?)(?:lx|W\/m²)/.exec(text) ?? assert.fail(text);
  return Number(digits.replaceAll("\u202f", "")) * { G: 1e9, M: 1e6, k: 1e3, m: 1e-3, µ: 1e-6, "": 1 }[prefix];
}

async function exitanceOf(page) {
  return Number(/Flux([\d.]+) lm/.exec(await page.locator(".facts").textContent())[1]);
}

export async function light_on_a_plane_is_read_by_pointer(scene) {
  const { page, job, service } = await modelOf(scene, sample("flat-chip", 400_000));
  const asked = [];
  page.on("request", (request) => { if (request.url().endsWith("/evaluations")) asked.push(request.postDataJSON().view.plane); });
  await card(page).scrollIntoViewIfNeeded();
  await fine(page);
  await accessible(page, "light on a plane");
  // A coarse picture first, finer ones then; a service that is slow is not asked for the finest.
  const columns = asked.map((plane) => plane.columns);
  assert.deepEqual(columns, [24, 64, 128].slice(0, columns.length));
  const flux = await exitanceOf(page);
  for (const distance of ["2", "0.5", "10"]) {
    await card(page).getByLabel("mm", { exact: true }).fill(distance);
    await page.waitForFunction((mm) => document.querySelector(".plane-card input[type=range]").getAttribute("aria-valuetext").startsWith(`${mm} mm`), distance === "2" ? "2.00" : distance === "0.5" ? "0.500" : "10.0");
    await fine(page);
    await page.locator("canvas.plane").scrollIntoViewIfNeeded();
    const box = await page.locator("canvas.plane").boundingBox();
    await page.mouse.move(box.x + box.width / 2 + 1, box.y + box.height / 2 + 1);
    await page.waitForFunction(() => /± .* · at \(/.test(document.querySelector(".plane-card .reading").textContent));
    const text = await card(page).locator(".reading").textContent();
    const exact = onAxis(flux, Number(distance));
    console.log(`  ${distance} mm: ${text}; a Lambertian square gives ${exact.toPrecision(4)} lx`);
    // Measured: 0.4 to 1 %, the noise of the rays of which the model was made.
    assert.ok(Math.abs(number(text) / exact - 1) < 0.02, `${text} at ${distance} mm; exact ${exact}`);
    await page.mouse.move(5, 5);
  }
  // A wrong length says what is wrong, and asks nothing.
  const before = asked.length;
  await card(page).getByLabel("Width, mm").fill("1,200");
  await card(page).getByText("Give a length above 0").waitFor();
  assert.equal(await card(page).getByLabel("Width, mm").getAttribute("aria-invalid"), "true");
  assert.equal(asked.length, before);
  await card(page).getByLabel("Width, mm").fill("4");
  await fine(page);
  assert.equal(asked.at(-1).width_mm, 4);
  // An empty distance is asked for, and given up with the focus.
  const [count, distance] = [asked.length, card(page).getByLabel("mm", { exact: true })];
  await distance.fill("");
  await card(page).getByText("Give the distance in mm").waitFor();
  assert.equal(await distance.getAttribute("aria-invalid"), "true");
  await distance.blur();
  assert.deepEqual([await distance.inputValue(), await distance.getAttribute("aria-invalid"), asked.length], ["10", "false", count]);
  assert.equal(await card(page).getByText("Give the distance in mm").count(), 0);
  // Very near, a mean of points may come to more than there is: no more than all of it is said to meet the plane.
  await card(page).getByLabel("Width, mm").fill("");
  await distance.fill("0.02");
  await fine(page);
  const meets = await card(page).locator(".figures div", { hasText: "Meets the plane" }).textContent();
  const [, part] = /\(([\d.]+)\u00a0%\)/.exec(meets) ?? [null, /all of it: /.test(meets) ? 100 : assert.fail(meets)];
  console.log(`  at 0.02 mm: ${meets}`);
  assert.ok(Number(part) > 95 && Number(part) <= 100, meets);
  await distance.fill("10");
  // From the side, and in W/m²: what the page says is what the service says.
  await card(page).getByLabel("Plane lies towards").selectOption({ label: "γ 90°, C 0° (+X)" });
  await card(page).getByLabel("Quantity").selectOption("radiant");
  await fine(page);
  const [{ largest }] = (await evaluated(service, job, { view: { plane: asked.at(-1) }, light: "radiant", tolerance: 0.005 })).channels;
  const shown = number(await card(page).locator(".figures dd").first().textContent());
  assert.ok(Math.abs(shown / largest - 1) < 0.01, `${shown}, the service says ${largest}`);
  assert.ok(Math.abs(asked.at(-1).center_mm[0] - 10.5) < 1e-3, `10 mm before the edge of the chip: ${asked.at(-1).center_mm}`);
  await card(page).getByLabel("Quantity").selectOption("color");
  await fine(page);
  await accessible(page, "colours on a plane");
  calm(page);
}

export async function light_on_a_plane_by_keyboard_as_files_and_by_command(scene) {
  const { page } = await modelOf(scene, sample("flat-chip", 200_000));
  await tabTo(page, "Distance in front of the light");
  await fine(page);
  const said = () => page.evaluate(() => document.getElementById("said").textContent);
  const at = () => page.locator(".plane-card input[type=range]").getAttribute("aria-valuetext");
  const before = await at();
  for (let pressed = 0; pressed < 10; pressed += 1) await page.keyboard.press("ArrowRight");
  assert.notEqual(await at(), before);
  await fine(page);
  await page.waitForFunction((text) => document.getElementById("said").textContent.startsWith(text), await at());
  assert.match(await said(), /at most [\d.]+ [Mk]?lx/);
  await tabTo(page, "Picture of the light on the plane");
  await page.keyboard.press("Home");
  await page.keyboard.press("Enter");
  await page.waitForFunction(() => /lx ± .* · at \(/.test(document.getElementById("said").textContent));
  const middle = number(await said());
  for (let pressed = 0; pressed < 3; pressed += 1) await page.keyboard.press("Shift+ArrowLeft");
  await page.keyboard.press("Enter");
  await page.waitForFunction((was) => document.getElementById("said").textContent !== was && /lx/.test(document.getElementById("said").textContent), await said());
  // Three eighths of the width from the middle there is less light.
  assert.ok(number(await said()) < 0.9 * middle, `${await said()}, in the middle ${middle}`);
  for (const [form, beginning] of [["CSV", "column,row,x_mm"], ["TIFF", "II*\0"], ["SVG", "<svg"]]) {
    const [download] = await Promise.all([page.waitForEvent("download"), (async () => {
      await tabTo(page, `Save as ${form}`);
      await page.keyboard.press("Enter");
    })()]);
    assert.match(download.suggestedFilename(), new RegExp(`flat-chip.*plane at [\\d.]+ mm\\.${form.toLowerCase()}`));
    const bytes = readFileSync(await download.path());
    assert.ok(bytes.subarray(0, 2000).toString("latin1").includes(beginning), bytes.subarray(0, 200).toString("latin1"));
  }
  await tabTo(page, "The same by command");
  await page.keyboard.press("Enter");
  const command = await card(page).locator("pre").textContent();
  const answer = JSON.parse(execFileSync("bash", ["-c", `${command} --silent --show-error`]).toString());
  assert.equal(answer.columns, await page.locator("canvas.plane").evaluate(({ width }) => width));
  const shown = number(await card(page).locator(".figures dd").first().textContent());
  assert.ok(Math.abs(shown / answer.channels[0].largest - 1) < 0.01, `${shown}, the command says ${answer.channels[0].largest}`);
  await accessible(page, "light on a plane, unfolded");
  calm(page);
}

export async function a_plane_that_moves_on_is_not_waited_for_and_a_busy_service_is_told(scene) {
  const { page } = await modelOf(scene, sample("flat-chip", 100_000), "", { viewport: { width: 360, height: 740 }, colorScheme: "dark" });
  const [asked, cancelled] = [[], []];
  page.on("request", (request) => { if (request.url().endsWith("/evaluations")) asked.push(request); });
  page.on("requestfailed", (request) => { if (request.url().endsWith("/evaluations")) cancelled.push(request); });
  // The service is slow: no answer until it is let go.
  let hold = true;
  await page.route("**/evaluations", async (route) => {
    while (hold) await new Promise((resolve) => { setTimeout(resolve, 50); });
    await route.continue().catch(() => {});
  });
  await card(page).scrollIntoViewIfNeeded();
  const until = async (test) => { while (!test()) await page.waitForTimeout(50); };
  await until(() => asked.length === 1);
  await page.getByText("The light is being computed.").waitFor();
  const slider = card(page).locator("input[type=range]");
  await slider.focus();
  // Many steps at once are one question, and the one before is not waited for.
  for (let pressed = 0; pressed < 20; pressed += 1) await page.keyboard.press("ArrowLeft");
  await until(() => asked.length >= 2 && cancelled.length >= 1);
  assert.ok(asked.length <= 6, `${asked.length} requests for twenty steps`);
  assert.equal(cancelled[0], asked[0]);
  hold = false;
  await fine(page);
  await fits(page, "light on a plane, narrow");
  await accessible(page, "light on a plane, dark and narrow");
  await page.unroute("**/evaluations");
  // Busy once, then free: the page says so, waits and goes on.
  let refused = 0;
  await page.route("**/evaluations", (route) => {
    refused += 1;
    if (refused > 1) return route.continue();
    return route.fulfill({ status: 503, headers: { "Retry-After": "2", "Content-Type": "application/problem+json" }, body: JSON.stringify({ title: "Busy", status: 503, code: "service.busy", detail: "Eight answers are being computed." }) });
  });
  await page.keyboard.press("ArrowLeft");
  await page.getByText("Eight answers are being computed. It is asked again in 2 s.").waitFor();
  await fine(page);
  await page.unroute("**/evaluations");
  // What cannot be computed: why, what to do, and another try.
  await page.route("**/evaluations", (route) => route.fulfill({ status: 422, headers: { "Content-Type": "application/problem+json" }, body: JSON.stringify({ title: "Too long", status: 422, code: "evaluation.too_long", detail: "It would take too long.", remedy: "Ask for fewer cells." }) }));
  await page.keyboard.press("ArrowLeft");
  await card(page).getByText("Ask for fewer cells.").waitFor();
  await card(page).getByText("What is shown is still the plane before.").waitFor();
  await accessible(page, "an evaluation that fails");
  await page.unroute("**/evaluations");
  await card(page).getByRole("button", { name: "Try again" }).click();
  await fine(page);
  assert.equal(await card(page).locator(".problem").count(), 0);
  calm(page);
}
