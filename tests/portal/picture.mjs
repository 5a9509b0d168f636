// What the pictures show, against closed forms: read back from the canvas.
import assert from "node:assert/strict";
import { open } from "./browser.mjs";
import { sample, Service } from "./service.mjs";

/** The page of a model of a known source. */
async function modelOf(scene, name, rays) {
  const service = await Service.start();
  scene.services.push(service);
  const { buffer } = sample(name, rays);
  const taken = await service.ask(`/v1/ray-sets?name=${name}`, { method: "POST", body: buffer });
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
  const page = await modelOf(scene, "flat-chip", 400_000);
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
  const page = await modelOf(scene, "cylinder", 400_000);
  const facts = await page.locator(".facts").textContent();
  const [, lm] = /Flux([\d.\u202f]+) lm/.exec(facts);
  // j = Φ/(4π V) with V = π r² h, and the line through the axis at right angles to it is 2 r long: r = 0.5 mm, h = 4 mm.
  const exact = ((Number(lm.replaceAll("\u202f", "")) / (4 * Math.PI * Math.PI * 0.25 * 4)) * 1e6);
  const { luminance } = await seen(page, 0, 90);
  console.log(`  ${(luminance / 1e6).toFixed(2)} Mcd/m², exact ${(exact / 1e6).toFixed(2)}`);
  // Measured: 2.3 %, the error of the lattice of the volume.
  assert.ok(Math.abs(luminance / exact - 1) < 0.04, `${luminance} cd/m², exact ${exact}`);
}
