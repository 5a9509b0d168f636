// `smoke.js URL KEY RAYS`: openapi-fetch with the generated types does what a client does.
import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { setTimeout } from "node:timers/promises";
import createClient from "openapi-fetch";
import type { components, paths } from "./lampwright.js";

type Job = components["schemas"]["Job"];
const [url, key, rays] = process.argv.slice(2);
assert(url && key && rays);
const client = createClient<paths>({ baseUrl: url, headers: { Authorization: `Bearer ${key}` } });

const bytes = readFileSync(rays);
const sent = await client.POST("/v1/ray-sets", {
  params: { query: { name: "chip.tm25ray" } },
  headers: { "Content-Type": "application/octet-stream" },
  body: new Blob([bytes]),
  bodySerializer: (body) => body,
});
const raySet = sent.data?.ray_sets[0];
assert(raySet, sent.error?.detail);
assert.deepEqual([raySet.name, raySet.byte_count], ["chip.tm25ray", bytes.length]);

const options: components["schemas"]["JobOptions"] = { goniogram: { zones: { columns: 2, rows: 1 } } };
const queued = await client.POST("/v1/jobs", {
  body: { channels: [{ ray_set: raySet.id, flux: { luminous_lm: 12.5 } }], options },
});
assert(queued.data && "state" in queued.data, queued.error?.detail);
let job: Job = queued.data;
const id = job.id;
for (const deadline = Date.now() + 240_000; job.state === "queued" || job.state === "running"; ) {
  assert(Date.now() < deadline);
  await setTimeout(100);
  const asked = await client.GET("/v1/jobs/{id}", { params: { path: { id } } });
  assert(asked.data, asked.error?.detail);
  job = asked.data;
}
assert.equal(job.state, "succeeded", job.problem?.detail);
assert.deepEqual(job.options?.goniogram?.zones, { columns: 2, rows: 1 });

const listed = await client.GET("/v1/jobs/{id}/artifacts", { params: { path: { id } } });
const zip = await client.GET("/v1/jobs/{id}/model.zip", { params: { path: { id } }, parseAs: "blob" });
const size: number | undefined = zip.data?.size;
assert.equal(size, listed.data?.zip?.byte_count);
const start = new Uint8Array((await zip.data?.slice(0, 4).arrayBuffer()) ?? []);
assert.deepEqual([...start], [0x50, 0x4b, 3, 4]);
const ies = listed.data?.artifacts.find((artifact) => artifact.name === "ies/total.ies");
assert(ies);
const path = { id, name: ies.name };
const text = await client.GET("/v1/jobs/{id}/artifacts/{name}", { params: { path }, parseAs: "text" });
assert.equal(Buffer.byteLength(String(text.data)), ies.byte_count);

const jobs = await client.GET("/v1/jobs", { params: { query: { state: ["succeeded"], limit: 1 } } });
assert.deepEqual(jobs.data?.jobs.map((one) => one.id), [id]);

const missing = await client.GET("/v1/jobs/{id}", { params: { path: { id: "00000000-0000-7000-8000-000000000000" } } });
const problem: components["schemas"]["Problem"] | undefined = missing.error;
assert.deepEqual([problem?.status, problem?.code], [404, "job.not_found"]);
// @ts-expect-error the contract knows its states
await client.GET("/v1/jobs", { params: { query: { state: ["lost"] } } });
const gone = await client.DELETE("/v1/jobs/{id}", { params: { path: { id } } });
assert.equal(gone.response.status, 204);
