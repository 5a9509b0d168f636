// The whole walk, by pointer and by keyboard alone: from a file to new rays.
import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { accessible, calm, drop, fits, open, tabTo } from "./browser.mjs";
import { bareText, sample, Service } from "./service.mjs";

const RAYS = 60_000;

async function scene_with(scene, options, page_options) {
  const service = await Service.start(options);
  scene.services.push(service);
  const page = await open(scene.browser, service, page_options);
  scene.pages.push(page);
  return { service, page };
}

/** The file that the page saves when its button is pressed. */
async function saved(page, press) {
  const [download] = await Promise.all([page.waitForEvent("download"), press()]);
  return readFileSync(await download.path());
}

export async function by_pointer_from_a_bare_text_to_new_rays(scene) {
  const { page, service } = await scene_with(scene);
  await page.getByText("None yet. A model is built").waitFor();
  await accessible(page, "first page");
  assert.match(await page.locator("#limits").textContent(), /64\.0 GiB/);

  await drop(page, [bareText(RAYS)]);
  await page.getByText("What stands in each column?").waitFor();
  await accessible(page, "columns");
  assert.deepEqual(await page.locator(".columns-form select").evaluateAll((all) => all.map((one) => one.value)), ["x", "y", "z", "l", "m", "n", "flux", "wavelength_nm"]);
  await page.getByText("Send again with these columns").click();

  await page.getByRole("heading", { name: "bare.txt" }).waitFor();
  await page.getByText("Still to be said:").waitFor();
  const build = page.getByRole("button", { name: "Build", exact: true });
  assert.ok(await build.isDisabled());
  await page.getByText("Not yet fit for a model.").waitFor();
  await page.getByLabel("Unit of length").selectOption("mm");
  await page.getByLabel("W or lm").selectOption("radiant");
  await page.getByText("60\u202f000 rays; about").waitFor();
  assert.equal(await page.getByText("Not yet fit for a model.").count(), 0);
  for (const drawing of await page.locator(".drawing img").all()) {
    await drawing.scrollIntoViewIfNeeded();
    await page.waitForFunction((image) => image.complete && image.naturalWidth > 100, await drawing.elementHandle());
  }
  assert.equal(await page.locator(".drawing img").count(), 2);
  await accessible(page, "inspection");
  await build.click();

  await page.locator("canvas.lamp").waitFor();
  await accessible(page, "model");
  // 1 W from 1 mm²: on the axis of a Lambertian square I = 1/π W/sr, half of it at 60° to each side; lm by the wavelength.
  const facts = await page.locator(".facts").textContent();
  assert.match(facts, /1\.000 W/);
  const width = /(1[12]\d(?:\.\d)?)° × (1[12]\d(?:\.\d)?)°/.exec(facts);
  assert.ok(width && width.slice(1).every((deg) => Math.abs(Number(deg) - 120) < 4), facts);
  assert.match(facts, /dominant 45\d nm/);
  const box = await page.locator("canvas.lamp").boundingBox();
  await page.mouse.move(box.x + box.width / 2, box.y + box.height / 2);
  await page.waitForFunction(() => /cd\/m² · zone 0 · at/.test(document.querySelector("#reading").textContent));
  await page.getByRole("heading", { name: "Zone 0" }).waitFor();

  await page.getByLabel("How many").fill("1000");
  await page.getByText("1\u202f000 rays are a file of").waitFor();
  const rays = await saved(page, () => page.getByRole("button", { name: "Draw new rays" }).click());
  assert.equal(rays.subarray(0, 4).toString(), "TM25");
  const taken = await service.ask("/v1/ray-sets?name=new", { method: "POST", body: rays });
  assert.equal(taken.ray_sets[0].header.ray_count, 1000);

  await page.getByText("For Blender, Mitsuba and Radiance", { exact: true }).first().click();
  const adapted = page.getByRole("button", { name: "Radiance", exact: true });
  await adapted.waitFor();
  await accessible(page, "files of renderers");
  const packed = await saved(page, () => adapted.click());
  assert.ok(packed.subarray(0, 4).equals(Buffer.from("PK\x03\x04")) && packed.includes("light.rad"), "a zip with Radiance's files");

  await page.getByRole("button", { name: "Delete model" }).click();
  await accessible(page, "question before deleting");
  await page.getByRole("button", { name: "Delete it" }).click();
  await page.getByText("None yet. A model is built").waitFor();
  assert.deepEqual((await service.ask("/v1/jobs")).jobs, []);
  calm(page);
}

export async function by_keyboard_alone_with_the_built_in_sample(scene) {
  const { page, service } = await scene_with(scene);
  await page.getByText("None yet. A model is built").waitFor();
  await tabTo(page, "Try the built-in sample");
  await page.keyboard.press("Enter");
  await page.getByText("Fit for a model.").waitFor();
  await page.getByText("200\u202f000 rays; about").waitFor();
  await tabTo(page, "first large");
  await page.keyboard.press("Enter");
  await page.locator("canvas.lamp").waitFor();
  await tabTo(page, "Picture of the lamp");
  // What is looked at moves to the right in the picture and up, as far as a twentieth of its height each; 0 brings it back.
  const target = () => page.evaluate(() => document.querySelector("canvas.lamp").view.camera.target);
  const middle = await target();
  for (const key of ["ArrowRight", "ArrowUp"]) await page.keyboard.press(`Alt+${key}`);
  const moved = await target();
  const { distance, tall } = await page.evaluate(() => {
    const { camera, canvas } = document.querySelector("canvas.lamp").view;
    return { distance: camera.distance, tall: camera.matrices(canvas.clientWidth / canvas.clientHeight).tall };
  });
  const far = Math.hypot(...moved.map((value, k) => value - middle[k]));
  assert.ok(Math.abs(far / (2 * distance * tall * 0.05 * Math.SQRT2) - 1) < 1e-6, `${middle} to ${moved}`);
  await page.keyboard.press("0");
  assert.deepEqual(await target(), middle);
  const whence = () => page.locator(".whence").textContent();
  const before = await whence();
  // The camera looks from γ 40° down to the axis: to the green chip's corner of the four.
  for (let pressed = 0; pressed < 8; pressed += 1) await page.keyboard.press("ArrowUp");
  await page.waitForFunction((was) => document.querySelector(".whence").textContent !== was, before);
  await page.waitForFunction(() => document.querySelector(".whence").textContent.includes("γ 0°"));
  for (const key of ["ArrowRight", "ArrowDown"]) for (let pressed = 0; pressed < 5; pressed += 1) await page.keyboard.press(`Shift+${key}`);
  await page.keyboard.press("Enter");
  await page.waitForFunction(() => /cd\/m² · zone \d .*Seen from/.test(document.getElementById("said").textContent));
  await tabTo(page, "How many");
  await page.keyboard.press("Control+A");
  await page.keyboard.type("5000");
  await page.getByText("5\u202f000 rays are a file of").waitFor();
  await tabTo(page, "Draw new rays");
  const rays = await saved(page, () => page.keyboard.press("Enter"));
  assert.equal(rays.subarray(0, 4).toString(), "TM25");
  await tabTo(page, "Delete model");
  await page.keyboard.press("Enter");
  await tabTo(page, "Delete it");
  await page.keyboard.press("Enter");
  await page.getByText("None yet. A model is built").waitFor();
  assert.equal((await service.ask("/v1/ray-sets")).ray_sets.length, 1);
  calm(page);
}

export async function two_files_become_one_source_with_shares(scene) {
  const { page, service } = await scene_with(scene);
  await page.setInputFiles("#files", [sample("flat-chip", 20_000), sample("boxed-chip", 20_000)]);
  await page.getByText("One source of 2 files").waitFor();
  for (const [k, share] of ["30", "70"].entries()) {
    await page.getByLabel("Flux of this file").nth(k).selectOption("luminous_share");
    await page.getByLabel("Value").nth(k).fill("1,200");
    await page.locator(".estimate").getByText(/the value of its flux, a plain number/).waitFor();
    assert.equal(await page.getByLabel("Value").nth(k).getAttribute("aria-invalid"), "true");
    await page.getByLabel("Value").nth(k).fill(share);
  }
  await page.getByLabel("Total flux of the source").selectOption("luminous_lm");
  await page.getByLabel("Value").nth(2).fill("100");
  await page.getByText("40\u202f000 rays; about").waitFor();
  await accessible(page, "two files");
  await page.getByRole("button", { name: "Build", exact: true }).click();
  await page.locator("canvas.lamp").waitFor();
  assert.match(await page.locator(".facts").textContent(), /100\.0 lm/);
  const [job] = (await service.ask("/v1/jobs")).jobs;
  assert.deepEqual(job.channels.map(({ flux }) => flux), [{ luminous_share: 0.3 }, { luminous_share: 0.7 }]);
  calm(page);
}

export async function narrow_and_dark_pages_keep_the_rules(scene) {
  const { page } = await scene_with(scene, {}, { viewport: { width: 360, height: 740 }, colorScheme: "dark", reducedMotion: "reduce" });
  await page.getByText("None yet. A model is built").waitFor();
  // The browser notes it a little after the text is there.
  const painted = await page.waitForFunction(() => performance.getEntriesByName("first-contentful-paint")[0]?.startTime);
  const paint = await painted.jsonValue();
  console.log(`  first paint after ${Math.round(paint)} ms`);
  await fits(page, "first page");
  await accessible(page, "first page, dark");
  await page.setInputFiles("#files", [sample("lit-sides", 30_000)]);
  await page.getByText("30\u202f000 rays; about").waitFor();
  await fits(page, "inspection");
  await accessible(page, "inspection, dark");
  await page.getByText("Options", { exact: true }).click();
  await fits(page, "options");
  await accessible(page, "options, dark");
  await page.getByRole("button", { name: "Build", exact: true }).click();
  await page.locator("canvas.lamp").waitFor();
  await fits(page, "model");
  for (const summary of await page.locator("summary").all()) await summary.click();
  await fits(page, "model, unfolded");
  await accessible(page, "model, dark");
  calm(page);
}
