// What the pictures show, against closed forms: read back from the canvas.
import assert from "node:assert/strict";
import { calm, open } from "./browser.mjs";
import { bareText, sample, Service } from "./service.mjs";

/** The page of a model of a known source. */
async function modelOf(scene, name, { buffer }, declared = "") {
  const service = await Service.start();
  scene.services.push(service);
  const taken = await service.ask(`/v1/ray-sets?name=${name}${declared}`, { method: "POST", body: buffer });
  const job = await service.ask("/v1/jobs", { method: "POST", body: JSON.stringify({ channels: [{ ray_set: taken.ray_sets[0].id }] }), headers: { "Content-Type": "application/json" } });
  const page = await open(scene.browser, service);
  scene.pages.push(page);
  await page.goto(`${service.url}/#/jobs/${job.id}`);
  await page.locator("canvas.lamp").waitFor();
  return page;
}

/** Looks from (C, γ) and reads: the mean of a square in the middle of the picture as its values and as its colours say. */
async function seen(page, c, gamma) {
  return page.evaluate(async ([atC, atGamma]) => {
    const { view } = document.querySelector("canvas.lamp");
    const app = new URL(document.querySelector("script[type=module]").src);
    const { falseColours } = await import(new URL("colour.js", app));
    Object.assign(view.camera, { c: atC, gamma: atGamma });
    view.moving = 0;
    view.render();
    const { gl, size } = view.picture;
    const [x, y, side] = [Math.floor(size[0] / 2) - 8, Math.floor(size[1] / 2) - 8, 16];
    const values = view.picture.read(x, y, side, side, "seen");
    const luminance = Array.from({ length: side * side }, (_, k) => 1e6 * values[4 * k + 1]);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    const pixels = new Uint8Array(4 * side * side);
    gl.readPixels(x, y, side, side, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    // A colour of the canvas as a part of the scale: the nearest of the false colours.
    const colours = falseColours();
    const part = (k) => {
      let [best, least] = [0, Infinity];
      for (let at = 0; at < 256; at += 1) {
        const off = [0, 1, 2].reduce((sum, axis) => sum + (pixels[4 * k + axis] - colours[4 * at + axis]) ** 2, 0);
        if (off < least) [best, least] = [at, off];
      }
      return best / 255;
    };
    const shown = luminance.map((_, k) => part(k) * view.greatest * 1e6);
    const mean = (list) => list.reduce((sum, value) => sum + value, 0) / list.length;
    return { luminance: mean(luminance), shown: mean(shown), caption: document.querySelector(".whence").textContent };
  }, [c, gamma]);
}

export async function a_flat_chip_is_equally_bright_from_everywhere(scene) {
  const page = await modelOf(scene, "flat-chip", sample("flat-chip", 400_000));
  const facts = await page.locator(".facts").textContent();
  const [, lm] = /Flux([\d.]+) lm/.exec(facts);
  // A Lambertian square of 1 mm²: L = M/π = Φ/(π mm²) in every direction.
  const exact = (Number(lm) / Math.PI) * 1e6;
  for (const [c, gamma] of [[0, 0], [0, 30], [120, 45], [300, 60], [45, 70]]) {
    const { luminance, shown, caption } = await seen(page, c, gamma);
    console.log(`  ${caption}: ${(luminance / 1e6).toFixed(3)} Mcd/m², exact ${(exact / 1e6).toFixed(3)}`);
    // Measured: within 0.3 %. The rays have a fixed seed.
    assert.ok(Math.abs(luminance / exact - 1) < 0.01, `C ${c}, γ ${gamma}: ${luminance} cd/m², exact ${exact}`);
    assert.ok(Math.abs(shown / luminance - 1) < 0.01, `the canvas shows ${shown}, the sum has ${luminance}`);
  }
  // From behind there is no light.
  assert.ok((await seen(page, 0, 150)).luminance < 0.01 * exact);
}

export async function a_glowing_cylinder_adds_up_along_the_line_of_sight(scene) {
  const page = await modelOf(scene, "cylinder", sample("cylinder", 400_000));
  const facts = await page.locator(".facts").textContent();
  const [, lm] = /Flux([\d.\u202f]+) lm/.exec(facts);
  // j = Φ/(4π V) with V = π r² h, and the line through the axis at right angles to it is 2 r long: r = 0.5 mm, h = 4 mm.
  const exact = ((Number(lm.replaceAll("\u202f", "")) / (4 * Math.PI * Math.PI * 0.25 * 4)) * 1e6);
  const { luminance } = await seen(page, 0, 90);
  console.log(`  ${(luminance / 1e6).toFixed(2)} Mcd/m², exact ${(exact / 1e6).toFixed(2)}`);
  // Measured: 2.3 %, the error of the lattice of the volume.
  assert.ok(Math.abs(luminance / exact - 1) < 0.04, `${luminance} cd/m², exact ${exact}`);
}

export async function an_infrared_lamp_is_shown_in_watts(scene) {
  const page = await modelOf(scene, "infrared", bareText(60_000, 940), "&length_unit=mm&quantity=radiant&columns=x,y,z,l,m,n,flux,wavelength_nm");
  const facts = await page.locator(".facts").textContent();
  // 1 W from a Lambertian square: I = 1/π W/sr on its axis; the noise of 60 000 rays is below a tenth of it.
  assert.match(facts, /Flux1\.000 W/);
  assert.match(facts, /Colourno visible light/);
  const [, peak] = /Peak intensity([\d.]+) W\/sr/.exec(facts) ?? assert.fail(facts);
  assert.ok(Math.abs(Number(peak) * Math.PI - 1) < 0.1, facts);
  await page.locator("section.card p", { hasText: "no visible light" }).waitFor();
  const box = await page.locator("canvas.lamp").boundingBox();
  await page.mouse.move(box.x + box.width / 2, box.y + box.height / 2);
  await page.waitForFunction(() => /W\/\(mm² sr\) · zone 0 · at/.test(document.querySelector("#reading").textContent));
  // L = M/π = 1/π W/(mm² sr).
  const seen = await page.evaluate(() => {
    const { view } = document.querySelector("canvas.lamp");
    Object.assign(view.camera, { c: 0, gamma: 20 });
    view.moving = 0;
    view.render();
    return view.valueAt(0.5, 0.5);
  });
  assert.equal(seen.unit, "W/(mm² sr)");
  assert.ok(Math.abs(seen.value * Math.PI - 1) < 0.1, JSON.stringify(seen));
  assert.deepEqual(await page.locator(".view select").first().locator("option").evaluateAll((all) => all.map(({ value }) => value)), ["seen", "exitance", "zones", "stages"]);
  calm(page);
}

export async function sections_are_bilinear_and_typed_numbers_plain(scene) {
  const service = await Service.start();
  scene.services.push(service);
  const page = await open(scene.browser, service);
  scene.pages.push(page);
  const found = await page.evaluate(async () => {
    const app = new URL(document.querySelector("script[type=module]").src);
    const { Directions, section } = await import(new URL("goniogram.js", app));
    const { typed } = await import(new URL("numbers.js", app));
    const frame = { axes_in_source: { x: [1, 0, 0], y: [0, 1, 0], z: [0, 0, 1] } };
    const directions = new Directions({ frame }, { c_deg: [0, 120, 240], gamma_deg: [0, 90, 180], interpolation_weight_sr: [1, 1, 1] });
    return {
      points: section([[8, 12, 0], [8, 24, 0], [8, 48, 0]], directions, 90),
      typed: ["1200", "98.5", "0,5", "12,25", "0,125", "1 200", "1,200", "98 lm", "1,200.5", "-3", "0x10", ""].map((text) => [text, typed(text)]),
    };
  });
  // C 90° is three quarters of the way from 0° to 120°, C 270° one quarter of that from 240° to 0°.
  assert.deepEqual(found.points.map(([gamma, value]) => [gamma, Math.round(1e9 * value) / 1e9]), [[-180, 0], [-90, 39], [0, 8], [90, 21], [180, 0]]);
  assert.deepEqual(found.typed, [
    ["1200", 1200], ["98.5", 98.5], ["0,5", 0.5], ["12,25", 12.25], ["0,125", 0.125], ["1 200", 1200],
    ["1,200", null], ["98 lm", null], ["1,200.5", null], ["-3", null], ["0x10", null], ["", null],
  ]);
  calm(page);
}
