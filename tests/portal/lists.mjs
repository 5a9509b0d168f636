// What the pages say of numbers that cannot be, of long lists, and of errors that noise hides.
import assert from "node:assert/strict";
import { accessible, calm, tabTo } from "./browser.mjs";
import { jobOf, modelOf, pageAt, serviceOf } from "./models.mjs";
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

/** The model's page takes a count as the command line does, and says of a zone without light that it has none. */
export async function counts_of_new_rays_and_a_zone_without_light(scene) {
  const service = await serviceOf(scene);
  const job = await jobOf(service, sample("flat-chip", 40_000));
  const page = await pageAt(scene, service, "#/");
  await page.route("**/artifacts/goniograms.json", async (route) => {
    const answer = await route.fetch();
    const document = await answer.json();
    for (const zone of document.zones) Object.assign(zone, { luminous_intensity_cd: null, radiant_intensity_W_per_sr: null });
    await route.fulfill({ json: document });
  });
  await page.goto(`${service.url}/#/jobs/${job.id}`);
  await page.locator("canvas.lamp").waitFor();
  const waiting = page.locator("[aria-labelledby=zone-title]");
  await waiting.getByText("Point at the lamp").waitFor();
  const box = await page.locator("canvas.lamp").boundingBox();
  await page.mouse.move(box.x + box.width / 2, box.y + box.height / 2);
  await waiting.getByText("Zone 0 sends no light.").waitFor();
  await accessible(page, "a zone without light");
  for (const [text, said] of [["1e6", "1\u202f000\u202f000 rays are"], ["2.5e3", "2\u202f500 rays are"], ["1E+3", "1\u202f000 rays are"], ["20 000", "20\u202f000 rays are"],
    ["1.5", "Give whole numbers"], ["7", "7 rays are"], ["1e99", "Give whole numbers"], ["9", "9 rays are"], ["1e-3", "Give whole numbers"], ["8", "8 rays are"], ["0", "Give whole numbers"]]) {
    await page.getByLabel("How many").fill(text);
    await page.locator("[aria-labelledby=rays-title]").getByText(said).waitFor();
  }
  await page.getByLabel("How many").fill("1e3");
  await page.getByText("1\u202f000 rays are").waitFor();
  const [drawn] = await Promise.all([page.waitForEvent("download"), page.getByRole("button", { name: "Draw new rays" }).click()]);
  assert.equal(drawn.suggestedFilename(), "rays-1000-seed-1.tm25ray");
  calm(page);
}

/** Colour over the angle of a tilted beam: a pair of half-planes without light is left out, and of none it is said why. */
export async function colour_over_angle_leaves_out_planes_without_light(scene) {
  const service = await serviceOf(scene);
  const page = await pageAt(scene, service, "#/");
  const charts = await page.evaluate(async () => {
    const app = new URL(document.querySelector("script[type=module]").src);
    const { colourOverAngle } = await import(new URL("hue.js", app));
    const { Directions } = await import(new URL("goniogram.js", app));
    const { weigher } = await import(new URL("colour.js", app));
    const [planes, gammas] = [[0, 45, 90, 135, 180, 225, 270, 315], [0, 30, 60, 90, 120, 150, 180]];
    const frame = { axes_in_source: { x: [1, 0, 0], y: [0, 1, 0], z: [0, 0, 1] } };
    const directions = new Directions({ frame }, { c_deg: planes, gamma_deg: gammas, interpolation_weight_sr: gammas.map(() => 1) });
    const edges = [440, 500, 560, 620];
    /** Two zones of two colours, each a beam in the half-plane C and the one after it. */
    const lampOf = (c) => {
      const zone = (gamma, bands) => ({
        luminous_intensity_cd: planes.map((plane) => gammas.map((at) => (plane === c && Math.abs(at - gamma) <= 30 ? 10 : 0))), spectral_flux_W_per_nm: bands,
      });
      const zones = [zone(30, [1, 0, 0]), zone(60, [0, 0, 1])];
      const total = { luminous_intensity_cd: zones[0].luminous_intensity_cd.map((row, j) => row.map((value, k) => value + zones[1].luminous_intensity_cd[j][k])), spectral_flux_W_per_nm: [1, 0, 1] };
      return { hasColour: true, goniograms: { total, zones }, directions, spectrum: { band_edges_nm: edges }, weigh: weigher(edges) };
    };
    return [0, 90, 45].map((c) => {
      const card = colourOverAngle(lampOf(c));
      return { text: card.textContent, curves: card.querySelectorAll("path").length, head: [...card.querySelectorAll("th")].map((cell) => cell.textContent) };
    });
  });
  const [across, along, between] = charts;
  assert.ok(across.text.includes("C0–C180") && !across.text.includes("C90–C270"), JSON.stringify(across));
  assert.ok(along.text.includes("C90–C270") && !along.text.includes("C0–C180"), JSON.stringify(along));
  assert.ok(across.curves > 0 && across.head.some((text) => text.includes("C0–C180")), JSON.stringify(across));
  assert.match(between.text, /too little light to tell its colour/);
  assert.equal(between.curves, 0);
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
