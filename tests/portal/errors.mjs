// What goes wrong: links that break, keys, files and jobs. The page says what to do each time.
import assert from "node:assert/strict";
import { accessible, calm, open } from "./browser.mjs";
import { sample, Service } from "./service.mjs";

async function begin(scene, options) {
  const service = await Service.start(options);
  scene.services.push(service);
  const page = await open(scene.browser, service);
  scene.pages.push(page);
  return { service, page };
}

export async function a_reload_in_mid_upload_goes_on(scene) {
  const { page, service } = await begin(scene);
  const file = sample("flat-chip", 100_000);
  const link = await page.context().newCDPSession(page);
  const slow = (rate) => link.send("Network.emulateNetworkConditions", { offline: false, latency: 0, downloadThroughput: -1, uploadThroughput: rate });
  await link.send("Network.enable");
  await slow(400_000);
  const [begun, offsets] = [[], []];
  page.on("request", (request) => {
    if (request.method() === "POST" && request.url().endsWith("/v1/uploads")) begun.push(request.url());
    if (request.method() === "PATCH") offsets.push(Number(request.headers()["upload-offset"]));
  });
  // What the service has not stored yet when the page asks anew is sent again: on a busy machine that may be all of it.
  await page.route("**/v1/uploads/*", async (route) => {
    const stored = async () => Number((await fetch(route.request().url(), { method: "HEAD", headers: { "Tus-Resumable": "1.0.0" } })).headers.get("Upload-Offset"));
    if (route.request().method() === "HEAD") while (!(await stored())) await new Promise((resolve) => { setTimeout(resolve, 100); });
    await route.continue();
  });
  await page.setInputFiles("#files", file);
  await page.waitForFunction(() => document.querySelector(".transfer progress")?.value > 0.3);
  await page.reload();
  await slow(-1);
  await page.getByText("Fit for a model.").waitFor();
  assert.equal(begun.length, 1, "the upload was begun once");
  assert.ok(offsets.length > 1 && offsets.at(-1) > 0, `it went on at ${offsets}`);
  const { ray_sets: sets } = await service.ask("/v1/ray-sets");
  assert.deepEqual(sets.map(({ byte_count: bytes }) => bytes), [file.buffer.length]);
  calm(page);
}

/** Begins an upload that is slow, and counts uploads begun and pieces sent by any page of the tab's profile. */
async function slowly(page) {
  const link = await page.context().newCDPSession(page);
  await link.send("Network.enable");
  await link.send("Network.emulateNetworkConditions", { offline: false, latency: 0, downloadThroughput: -1, uploadThroughput: 400_000 });
  const told = { begun: 0, pieces: 0 };
  page.context().on("request", (request) => {
    if (request.method() === "POST" && request.url().endsWith("/v1/uploads")) told.begun += 1;
    if (request.method() === "PATCH") told.pieces += 1;
  });
  await page.setInputFiles("#files", sample("flat-chip", 100_000));
  await page.waitForFunction(() => document.querySelector(".transfer progress")?.value > 0.3);
  return told;
}

export async function an_upload_that_is_not_known_any_more_is_begun_anew_only_when_asked_for(scene) {
  const { page, service } = await begin(scene);
  const [location] = await Promise.all([page.waitForResponse((answer) => answer.request().method() === "POST" && answer.url().endsWith("/v1/uploads")).then((answer) => answer.headerValue("location")), slowly(page).then((told) => { page.told = told; })]);
  await page.goto("about:blank");
  await service.ask(new URL(location, service.url).pathname, { method: "DELETE", headers: { "Tus-Resumable": "1.0.0" } });
  await page.goto(`${service.url}/`);
  await page.locator(".transfer").getByText("Not known here any more; send it again?").waitFor();
  await accessible(page, "an upload that is gone");
  assert.equal(page.told.begun, 1);
  assert.deepEqual((await service.ask("/v1/ray-sets")).ray_sets, []);
  await page.getByRole("button", { name: "Send it again" }).click();
  await page.getByText("Fit for a model.").waitFor();
  assert.equal(page.told.begun, 2);
  // Nothing is kept for a page that comes later.
  await page.goto("about:blank");
  await page.goto(`${service.url}/`);
  await page.getByRole("link", { name: "flat-chip.tm25ray" }).first().waitFor();
  assert.equal(await page.locator(".transfer").count(), 0);
  calm(page);
}

export async function a_second_tab_does_not_send_what_the_first_is_sending(scene) {
  const { page, service } = await begin(scene);
  const told = await slowly(page);
  const second = await page.context().newPage();
  scene.pages.push(second);
  second.seen = [];
  second.setDefaultTimeout(180_000);
  await second.goto(`${service.url}/`);
  await second.locator(".transfer").getByText("Begins:").waitFor();
  await page.getByText("Fit for a model.").waitFor();
  await second.locator(".transfer").getByText("Another tab has seen to it.").waitFor();
  assert.deepEqual(told, { begun: 1, pieces: 1 });
  calm(page);
}

export async function a_service_that_dies_in_mid_upload_is_waited_for(scene) {
  const { page, service } = await begin(scene);
  const file = sample("flat-chip", 100_000);
  const link = await page.context().newCDPSession(page);
  await link.send("Network.enable");
  await link.send("Network.emulateNetworkConditions", { offline: false, latency: 0, downloadThroughput: -1, uploadThroughput: 400_000 });
  await page.setInputFiles("#files", file);
  await page.waitForFunction(() => document.querySelector(".transfer progress")?.value > 0.3);
  await service.kill();
  await page.locator(".transfer").getByText("The link is lost;").waitFor();
  const again = await Service.start({ data: service.folder, port: new URL(service.url).port });
  scene.services.push(again);
  await page.getByText("Fit for a model.").waitFor();
  calm(page);
}

export async function keys_are_asked_for_and_kept_for_the_tab(scene) {
  const { page, service } = await begin(scene, { keys: true });
  await page.getByText("This service asks for a key").waitFor();
  await accessible(page, "question for a key");
  await page.getByLabel("Key", { exact: true }).fill("lw_wrong");
  await page.getByRole("button", { name: "Use this key" }).click();
  await page.locator("dialog").getByText("The service does not know this key").waitFor();
  await page.getByLabel("Key", { exact: true }).fill(service.key);
  await page.getByRole("button", { name: "Use this key" }).click();
  await page.getByText("None yet. A model is built").waitFor();
  assert.equal(await page.evaluate(() => localStorage.length), 0);
  await page.setInputFiles("#files", sample("flat-chip", 20_000));
  await page.getByText("Fit for a model").waitFor();
  // With a key the page fetches the drawings itself.
  await page.waitForFunction(() => [...document.querySelectorAll(".drawing")].every((place) => place.shadowRoot?.querySelector("svg path, svg rect")));
  await page.getByRole("button", { name: "Build", exact: true }).click();
  await page.locator("canvas.lamp").waitFor();
  // The model is evaluated with the key as well; the command names it, and does not tell it.
  await page.locator(".plane-card").scrollIntoViewIfNeeded();
  await page.locator(".plane-card").getByText(/points, each with an error/).waitFor();
  const command = await page.locator(".plane-card pre").textContent();
  assert.ok(command.includes('"Authorization: Bearer $KEY"') && !command.includes(service.key), command);
  const [download] = await Promise.all([page.waitForEvent("download"), page.getByRole("button", { name: "Everything in one zip file" }).click()]);
  assert.match(download.suggestedFilename(), /flat-chip\.tm25ray\.zip/);
  await page.reload();
  await page.locator("canvas.lamp").waitFor();
  await page.getByRole("button", { name: "Forget the key" }).click();
  await page.getByText("This service asks for a key").waitFor();
  calm(page);
}

export async function a_broken_file_says_what_to_do(scene) {
  const { page } = await begin(scene);
  const whole = sample("flat-chip", 20_000);
  const broken = { ...whole, buffer: whole.buffer.subarray(0, 200_000) };
  const html = { name: "page.tm25ray", mimeType: "text/html", buffer: Buffer.from("<!doctype html><html><body>Sign in</body></html>") };
  await page.setInputFiles("#files", [broken, html]);
  await page.getByText("Code tm25.size").waitFor();
  await page.getByText("Code detect.html").waitFor();
  assert.equal(await page.locator(".transfer .problem").getByText("What to do:").count(), 2);
  await accessible(page, "refused files");
  await page.goto(`${page.url().split("#")[0]}#/jobs/00000000-0000-7000-8000-000000000000`);
  await page.getByRole("button", { name: "Try again" }).waitFor();
  await page.goto(`${page.url().split("#")[0]}#/nothing`);
  await page.getByText("There is no such page").waitFor();
  calm(page);
}

export async function a_waiting_job_shows_its_place_and_can_be_cancelled(scene) {
  const { page, service } = await begin(scene, { flags: ["--jobs", "1", "--threads", "1"] });
  const { ray_sets: [{ id }] } = await service.ask("/v1/ray-sets?name=dome", { method: "POST", body: sample("dome", 400_000).buffer });
  const submit = () => service.ask("/v1/jobs", { method: "POST", body: JSON.stringify({ channels: [{ ray_set: id }], reuse: false }), headers: { "Content-Type": "application/json" } });
  const [first, , last] = [await submit(), await submit(), await submit()];
  await page.goto(`${service.url}/#/jobs/${last.id}`);
  await page.locator(".job").getByText(/Waiting: number [12] in the queue/).waitFor();
  await accessible(page, "progress");
  await page.getByRole("button", { name: "Cancel the job" }).click();
  await page.getByRole("heading", { name: "The job was cancelled" }).waitFor();
  await page.getByRole("link", { name: "Back to its files" }).waitFor();
  // One that runs moves its bar; a service that dies meanwhile is waited for.
  await page.goto(`${service.url}/#/jobs/${first.id}`);
  await page.waitForFunction(() => document.querySelector(".job progress")?.value > 0 || document.querySelector("canvas.lamp"));
  if (await page.locator(".job progress").count()) {
    await service.kill();
    await page.getByText("The service does not answer.").waitFor();
    scene.services.push(await Service.start({ data: service.folder, port: new URL(service.url).port }));
  }
  await page.locator("canvas.lamp").waitFor();
  calm(page);
}
