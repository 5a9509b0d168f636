// Two models side by side: chosen from the recent ones, one camera and one scale, their difference and their figures.
import assert from "node:assert/strict";
import { accessible, calm, fits, tabTo } from "./browser.mjs";
import { jobOf, pageAt, serviceOf } from "./models.mjs";
import { sample } from "./service.mjs";

const state = (page) => page.evaluate(() => [...document.querySelectorAll("canvas.lamp")].map(({ view }) => ({
  c: view.camera.c, gamma: view.camera.gamma, greatest: view.greatest, mode: view.mode, isShared: view.camera === document.querySelector("canvas.lamp").view.camera,
})));

/** Both pictures rest and their difference is there. */
const rested = (page) => page.waitForFunction(() => {
  const found = [...document.querySelectorAll("canvas.lamp")].map(({ view }) => view);
  return found.length === 2 && found.every((view) => view.greatest && view.greatest === found[0].greatest) && /Root mean square/.test(document.querySelector("[aria-labelledby=difference-title] [role=status]").textContent);
});

export async function two_models_side_by_side_by_pointer(scene) {
  const service = await serviceOf(scene);
  // The same chip twice, and one with four times the flux of it in four chips.
  const first = await jobOf(service, sample("flat-chip", 100_000));
  const second = await jobOf(service, { ...sample("flat-chip", 120_000), name: "other.tm25ray" });
  const third = await jobOf(service, sample("four-chips", 100_000));
  const page = await pageAt(scene, service, `#/jobs/${first.id}`);
  await page.getByRole("button", { name: "Compare …" }).click();
  await page.getByRole("link", { name: "other.tm25ray" }).waitFor();
  await accessible(page, "choice of another model");
  assert.equal(await page.locator("dialog .choices li").count(), 2);
  await page.getByRole("link", { name: "other.tm25ray" }).click();
  await page.getByRole("heading", { name: "flat-chip.tm25ray and other.tm25ray" }).waitFor();
  await rested(page);
  await accessible(page, "two models");
  const [one, two] = await state(page);
  assert.ok(two.isShared && one.greatest === two.greatest, JSON.stringify([one, two]));
  // Alike but for the noise of the rays: the difference is a few per cent of the peak.
  const rms = Number(/lit: (?:< )?([\d.]+)/.exec((await page.locator("[aria-labelledby=difference-title] [role=status]").textContent()).replaceAll("\u00a0", " "))[1]);
  assert.ok(rms < 5, `${rms} %`);
  // Turning one turns both.
  const boxes = await page.locator("canvas.lamp").evaluateAll((all) => all.map((canvas) => canvas.getBoundingClientRect().toJSON()));
  await page.mouse.move(boxes[1].x + 100, boxes[1].y + 100);
  await page.mouse.down();
  await page.mouse.move(boxes[1].x + 160, boxes[1].y + 130, { steps: 4 });
  await page.mouse.up();
  const turned = await state(page);
  assert.ok(turned[0].c !== one.c && turned[0].c === turned[1].c);
  await page.waitForFunction(() => new Set([...document.querySelectorAll(".whence")].map((place) => place.textContent)).size === 1);
  await rested(page);
  // One pointer: both values and the difference are read at once.
  await page.mouse.move(boxes[0].x + boxes[0].width / 2, boxes[0].y + boxes[0].height / 2);
  await page.waitForFunction(() => [...document.querySelectorAll(".half .reading")].every((place) => /cd\/m²/.test(place.textContent)) && /brighter|darker|Alike/.test(document.querySelector("[aria-labelledby=difference-title] .reading").textContent));
  await page.getByLabel("Show", { exact: true }).selectOption("solid");
  await page.getByText("The difference is shown of what is seen and of exitance.").waitFor();
  assert.deepEqual((await state(page)).map(({ mode }) => mode), ["solid", "solid"]);
  await page.goto(`${service.url}/#/compare/${first.id},${third.id}`);
  await page.getByRole("heading", { name: "flat-chip.tm25ray and four-chips.tm25ray" }).waitFor();
  await rested(page);
  // The figures: each model's own flux, and by how much they differ.
  const cells = await page.locator("[aria-labelledby=figures-title] tbody tr").first().locator("th, td").allTextContents();
  const numbers = cells.slice(1).map((text) => Number(/[\d.]+/.exec(text.replaceAll("\u202f", ""))[0]));
  const fluxes = await Promise.all([first, third].map(({ id }) => service.ask(`/v1/jobs/${id}/artifacts/goniograms.json`).then(({ total }) => total.flux_lm)));
  assert.ok(Math.abs(numbers[0] / fluxes[0] - 1) < 1e-3 && Math.abs(numbers[1] / fluxes[1] - 1) < 1e-3, cells.join("; "));
  assert.ok(Math.abs(numbers[2] - 100 * (fluxes[1] / fluxes[0] - 1)) < 0.01 * numbers[2] + 0.1, cells.join("; "));
  calm(page);
}

export async function two_models_side_by_side_by_keyboard_dark_and_narrow(scene) {
  const service = await serviceOf(scene);
  const first = await jobOf(service, sample("flat-chip", 60_000));
  await jobOf(service, { ...sample("flat-chip", 50_000), name: "other.tm25ray" });
  const page = await pageAt(scene, service, `#/jobs/${first.id}`, { viewport: { width: 360, height: 740 }, colorScheme: "dark", reducedMotion: "reduce" });
  await page.locator("canvas.lamp").waitFor();
  await tabTo(page, "Compare …");
  await page.keyboard.press("Enter");
  await page.getByRole("link", { name: "other.tm25ray" }).waitFor();
  await tabTo(page, "other.tm25ray");
  await page.keyboard.press("Enter");
  await rested(page);
  await fits(page, "two models, narrow");
  await accessible(page, "two models, dark");
  await tabTo(page, "Picture of the lamp");
  for (const key of ["ArrowLeft", "ArrowUp", "+"]) await page.keyboard.press(key);
  const [one, two] = await state(page);
  assert.deepEqual([one.c, one.gamma], [two.c, two.gamma]);
  assert.deepEqual([one.c, one.gamma], [295, 35]);
  await rested(page);
  await page.keyboard.press("Enter");
  await page.waitForFunction(() => /cd\/m².*Seen from/.test(document.getElementById("said").textContent));
  calm(page);
}
