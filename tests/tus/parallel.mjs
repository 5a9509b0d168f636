// tus-js-client, a client by other people, sends one ray file as three partial uploads at once to the binary; the service's
// SHA-256 must be node's. `parallel.mjs` takes the same environment as kills.py: LAMPWRIGHT, and the engines of tests/engines/with.
import assert from "node:assert/strict";
import { spawn } from "node:child_process";
import { createHash } from "node:crypto";
import { mkdtempSync, rmSync } from "node:fs";
import { createRequire } from "node:module";
import { createServer } from "node:net";
import { tmpdir } from "node:os";
import { dirname, join, resolve } from "node:path";
import { setTimeout as sleep } from "node:timers/promises";
import { fileURLToPath, pathToFileURL } from "node:url";

const here = dirname(fileURLToPath(import.meta.url));
const home = process.env.JUDGES ?? join(here, "../../target/judges");
const { Upload } = createRequire(pathToFileURL(resolve(home, "package.json")))("tus-js-client");
const binary = process.env.LAMPWRIGHT ?? join(here, "../../target/debug/lampwright");
const MIB = 6;
// Longest wait for anything, on a machine busy with others, s.
const PATIENCE_S = 600;

/** A Zemax binary source file of about so many MiB, after the vendor's format page. */
function rayFile(mib) {
  const rays = Math.floor(((mib << 20) - 208) / 28);
  const file = Buffer.alloc(208 + 28 * rays);
  file.writeInt32LE(1010, 0);
  file.writeUInt32LE(rays, 4);
  file.write("test", 8);
  for (const [at, value] of [[108, rays], [112, rays], [116, 0.55]]) file.writeFloatLE(value, at);
  file.writeInt32LE(4, 136);
  for (let ray = 0, at = 208; ray < rays; ray += 1, at += 28) {
    file.writeFloatLE((ray % 997) / 997, at);
    file.writeFloatLE((ray % 991) / 991, at + 4);
    file.writeFloatLE(1, at + 20);
    file.writeFloatLE(1, at + 24);
  }
  return file;
}

function freePort() {
  return new Promise((found, failed) => {
    const probe = createServer().once("error", failed);
    probe.listen(0, "127.0.0.1", () => {
      const { port } = probe.address();
      probe.close(() => found(port));
    });
  });
}

/** Starts the binary in a folder; its address, once it is ready. */
async function serve(folder) {
  const address = `127.0.0.1:${await freePort()}`;
  const words = ["serve", "--listen", address, "--data", join(folder, "data"), "--role", "api", "--no-sample", "--log", "warn"];
  const { TEST_DATABASE_URL: database, TEST_STORAGE_URL: storage } = process.env;
  if (database) words.push("--database-url", database, "--storage-url", `${storage}/tus`);
  const ours = ([name]) => !/^LAMPWRIGHT_|(DATABASE|STORAGE)_URL$|ROLE$/.test(name);
  const env = Object.fromEntries(Object.entries(process.env).filter(ours));
  const server = spawn(binary, words, { env, stdio: ["ignore", "ignore", "inherit"] });
  process.on("exit", () => server.kill("SIGKILL"));
  for (const end = Date.now() + PATIENCE_S * 1000; ; await sleep(50)) {
    assert(server.exitCode === null && Date.now() < end, "the server did not start");
    const answer = await fetch(`http://${address}/readyz`).catch(() => null);
    if (answer?.status === 200) return { server, site: `http://${address}` };
  }
}

const json = async (url) => (await fetch(url)).json();

/** Sends the file as so many uploads at once; where the final one is, and how many requests began an upload. */
function send(site, file, parallelUploads) {
  let begun = 0;
  return new Promise((done, failed) => {
    const upload = new Upload(file, {
      endpoint: `${site}/v1/uploads`,
      parallelUploads,
      metadata: { filename: "parallel.dat", length_unit: "mm", quantity: "radiant" },
      onBeforeRequest: (request) => { begun += request.getMethod() === "POST" ? 1 : 0; },
      // Without its requests, which are pages long.
      onError: (error) => failed(new Error(error.message)),
      onSuccess: () => done({ url: upload.url, begun }),
    });
    upload.start();
  });
}

const folder = mkdtempSync(join(tmpdir(), "tus-parallel-"));
process.on("exit", () => rmSync(folder, { recursive: true, force: true }));
const file = rayFile(MIB);
const expected = createHash("sha256").update(file).digest("hex");
const { server, site } = await serve(folder);
const before = (await json(`${site}/v1/ray-sets?limit=100`)).ray_sets.length;
const { url, begun } = await send(site, file, 3);
assert.equal(begun, 4, "three partial uploads and the final one");
let upload;
for (const end = Date.now() + PATIENCE_S * 1000; ; await sleep(50)) {
  upload = await json(url);
  if (upload.state !== "finishing") break;
  assert(Date.now() < end, "the upload does not end");
}
assert.equal(upload.state, "taken", JSON.stringify(upload));
assert.equal(upload.ray_sets.length, 1);
const raySet = await json(`${site}/v1/ray-sets/${upload.ray_sets[0]}`);
assert.deepEqual([raySet.sha256, raySet.byte_count, raySet.name], [expected, file.length, "parallel.dat"]);
assert.deepEqual(raySet.declared, { length_unit: "mm", quantity: "radiant" });
const after = (await json(`${site}/v1/ray-sets?limit=100`)).ray_sets.length;
assert.equal(after, before + 1, "a piece has become a ray set");
assert.equal((await fetch(`${site}/v1/ray-sets/${raySet.id}`, { method: "DELETE" })).status, 204);
console.log(`tus-js-client: ${file.length} bytes as 3 uploads at once, SHA-256 equal, one ray set`);
server.kill("SIGKILL");
process.exit(0);
