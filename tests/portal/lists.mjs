// What the pages say of numbers that cannot be, of long lists, and of errors that noise hides.
import assert from "node:assert/strict";
import { accessible, calm, tabTo } from "./browser.mjs";
import { modelOf, pageAt, serviceOf } from "./models.mjs";
import { bareText, sample } from "./service.mjs";

export async function options_that_cannot_be_are_told(scene) {
  const service = await serviceOf(scene);
  const { ray_sets: [{ id }] } = await service.ask("/v1/ray-sets?name=chip", { method: "POST", body: sample("flat-chip", 20_000).buffer });
  const page = await pageAt(scene, service, `#/ray-sets/${id}`);
  await page.getByText("20\u202f000 rays; about").waitFor();
  await page.getByText("Options", { exact: true }).click();
  const asked = [];
  page.on("request", (request) => { if (request.url().endsWith("dry_run=true")) asked.push(request.postDataJSON().options); });
  const build = page.getByRole("button", { name: "Build", exact: true });
  // No number, too much, no whole number, and what does not divide the circle.
  for (const [label, wrong, right, read] of [["Resolution", "fine", "32", (options) => options.hull.resolution], ["Columns of the lattice", "33", "2", (options) => options.goniogram.zones.columns],
    ["Rows of the lattice", "1.5", "3", (options) => options.goniogram.zones.rows], ["Step of C, degrees", "7", "7,5", (options) => options.goniogram.c_step_deg]]) {
    const field = page.getByLabel(label, { exact: true });
    await field.fill(wrong);
    await page.locator(".estimate").getByText(`a number for “${label}”`).waitFor();
    assert.equal(await field.getAttribute("aria-invalid"), "true");
    assert.ok(await build.isDisabled());
    if (label === "Resolution") await accessible(page, "an option that cannot be");
    await field.fill(right);
    await page.getByText("20\u202f000 rays; about").waitFor();
    assert.equal(await field.getAttribute("aria-invalid"), "false");
    assert.equal(read(asked.at(-1)), Number(right.replace(",", ".")));
  }
  assert.ok(await build.isEnabled());
  calm(page);
}

export async function long_lists_show_the_first_few_and_all_when_asked(scene) {
  const service = await serviceOf(scene);
  for (let k = 0; k < 9; k += 1) {
    await service.ask(`/v1/ray-sets?name=set-${k}&length_unit=mm&quantity=radiant&columns=x,y,z,l,m,n,flux,wavelength_nm`, { method: "POST", body: bareText(40 + k).buffer });
  }
  const page = await pageAt(scene, service, "#/");
  const entries = page.locator("[aria-labelledby=ray-sets-title] .cards > li");
  await page.getByRole("button", { name: "Show all" }).waitFor();
  assert.equal(await entries.count(), 6);
  await page.getByLabel("Choose set-7 to join it with others").check();
  await tabTo(page, "Show all");
  await page.keyboard.press("Enter");
  await page.getByRole("link", { name: "set-0" }).waitFor();
  assert.equal(await entries.count(), 9);
  // The first that was left out has the focus, and what was ticked still is.
  assert.equal(await page.evaluate(() => document.activeElement.textContent), "set-2");
  assert.ok(await page.getByLabel("Choose set-7 to join it with others").isChecked());
  await page.getByLabel("Choose set-0 to join it with others").check();
  await page.getByRole("link", { name: "Join 2 files to one source" }).waitFor();
  await accessible(page, "all of a long list");
  calm(page);
}

/** The page and README.txt of the model say the same of each error. */
export async function errors_below_the_noise_are_called_so_as_in_the_readme(scene) {
  const { page, job, service } = await modelOf(scene, sample("four-chips", 100_000));
  const readme = await (await fetch(new URL(`/v1/jobs/${job.id}/artifacts/README.txt`, service.url))).text();
  const said = readme.split("\n").filter((line) => /^ {4}(plane|far field|seen|spectrum)/.test(line)).map((line) => line.includes("below the noise"));
  assert.ok(said.length >= 8 && said.some(Boolean) && !said.every(Boolean), readme);
  const shown = await page.locator("#quality tbody tr").evaluateAll((rows) => rows.map((row) => row.querySelector("td").textContent === "below the noise"));
  assert.deepEqual(shown, said);
  // Evaluation is named where a script would look for it.
  await page.getByText("curl commands of this page").click();
  assert.match(await page.locator("[aria-labelledby=commands-title]").textContent(), /POST \/v1\/jobs\/\{id\}\/evaluations/);
  // Colour over angle: four chips of four colours are one colour far away but for noise, and the chart says how far.
  await page.getByRole("img", { name: "Distance of the colour from that of the whole source, by direction" }).waitFor();
  assert.equal(await page.getByRole("img", { name: "Intensity of the whole source by direction, over the angle" }).count(), 1);
  calm(page);
}
