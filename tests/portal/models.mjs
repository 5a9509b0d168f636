// Models of known sources, made by the service, and their pages.
import { open } from "./browser.mjs";
import { Service } from "./service.mjs";

/** A service of the scene. */
export async function serviceOf(scene, options) {
  const service = await Service.start(options);
  scene.services.push(service);
  return service;
}

/** The job of a model of this file, finished; `declared` is added to the upload's query. */
export async function jobOf(service, { name, buffer }, declared = "") {
  const taken = await service.ask(`/v1/ray-sets?name=${name}${declared}`, { method: "POST", body: buffer });
  const submitted = await service.ask("/v1/jobs", { method: "POST", body: JSON.stringify({ channels: [{ ray_set: taken.ray_sets[0].id }] }), headers: { "Content-Type": "application/json" } });
  let job = submitted;
  while (job.state === "queued" || job.state === "running") job = await service.ask(`/v1/jobs/${submitted.id}?wait=30`);
  if (job.state !== "succeeded") throw new Error(`the job of ${name} has ${job.state}`);
  return job;
}

/** A page of the scene at an address of the portal, as `#/jobs/ID`. */
export async function pageAt(scene, service, hash, options) {
  const page = await open(scene.browser, service, options);
  scene.pages.push(page);
  await page.goto(`${service.url}/${hash}`);
  return page;
}

/** The page of a model of this file; `job` and `service` beside it. */
export async function modelOf(scene, file, declared = "", options = {}) {
  const service = await serviceOf(scene);
  const job = await jobOf(service, file, declared);
  const page = await pageAt(scene, service, `#/jobs/${job.id}`, options);
  await page.locator("canvas.lamp").waitFor();
  return { page, job, service };
}

/** What the service says of the model. */
export function evaluated(service, job, question) {
  return service.ask(`/v1/jobs/${job.id}/evaluations`, { method: "POST", body: JSON.stringify(question), headers: { "Content-Type": "application/json" } });
}
