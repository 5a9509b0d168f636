// Judges of form, from node: gltf-validator on every GLB; three.js and Babylon.js, the strictest readers, on every IES file.
// Usage: node judge.mjs DIR [DIR..]. Exit 1 if anything fails or if nothing was checked.
import { createRequire } from "node:module";
import { readFileSync, readdirSync } from "node:fs";
import { dirname, join, resolve } from "node:path";
import { fileURLToPath, pathToFileURL } from "node:url";

const here = dirname(fileURLToPath(import.meta.url));
const home = process.env.JUDGES ?? join(here, "../../target/judges");
const require = createRequire(pathToFileURL(resolve(home, "package.json")));
const load = (name) => import(pathToFileURL(require.resolve(name)));
const validator = require("gltf-validator");
const { IESLoader } = await load("three/examples/jsm/loaders/IESLoader.js");
const { GLTFLoader } = await load("three/examples/jsm/loaders/GLTFLoader.js");
const { LoadIESData } = await load("@babylonjs/core/Lights/IES/iesLoader.js");

let checked = 0;
let failed = 0;
function check(good, words) {
  checked += 1;
  if (!good) {
    failed += 1;
    console.log(`  FAILED: ${words}`);
  }
}

const lit = (data) => data.length > 0 && data.every(Number.isFinite) && data.some((value) => value > 0);

// What the validator says of an extension that it does not know: the name, and that it sees no use of the view with the IES file.
const isOfLight = ({ code, pointer }) => code === "UNSUPPORTED_EXTENSION" && pointer === "/extensionsUsed/1"
  || code === "UNUSED_OBJECT" && pointer.startsWith("/bufferViews/");

async function judgeGlb(path) {
  const bytes = new Uint8Array(readFileSync(path));
  const { issues, info } = await validator.validateBytes(bytes, { maxIssues: 20 });
  const messages = issues.messages.filter((message) => !isOfLight(message));
  messages.forEach((message) => console.log(`  ${message.code} ${message.pointer}: ${message.message}`));
  const { numErrors, numWarnings, numInfos } = issues;
  check(messages.length === 0 && issues.messages.length <= 2, `${path}: ${JSON.stringify(issues)}`);
  const { scene } = await new GLTFLoader().parseAsync(bytes.buffer, "");
  const meshes = [];
  let lights = 0;
  scene.traverse((node) => {
    if (node.geometry) meshes.push(node.geometry.attributes.position.count);
    if (node.userData.gltfExtensions?.EXT_lights_ies) lights += 1;
  });
  check(meshes.length > 0 && meshes.every((count) => count > 0), `three.js found no surface in ${path}`);
  check(lights === issues.messages.length / 2, `three.js found ${lights} lights in ${path}`);
  console.log(`gltf-validator: ${info.totalVertexCount} vertices, ${info.totalTriangleCount} triangles, `
    + `${numErrors} errors, ${numWarnings} warnings, ${numInfos} infos`);
}

function judgeIes(path) {
  const bytes = readFileSync(path);
  for (const [reader, parse] of [
    ["three.js", () => new IESLoader().parse(bytes.toString("latin1")).image.data],
    ["Babylon.js", () => LoadIESData(new Uint8Array(bytes)).data],
  ]) {
    try {
      check(lit(Array.from(parse())), `${reader} found no light in ${path}`);
    } catch (error) {
      check(false, `${reader} refused ${path}: ${error}`);
    }
  }
}

for (const folder of process.argv.slice(2)) {
  console.log(folder);
  await judgeGlb(join(folder, "emitter.glb"));
  let files = [];
  try {
    files = readdirSync(join(folder, "ies")).filter((name) => name.endsWith(".ies"));
  } catch (error) {
    if (error.code !== "ENOENT") throw error; // a radiant source has no IES files
  }
  files.forEach((name) => judgeIes(join(folder, "ies", name)));
  console.log(`three.js, Babylon.js: ${files.length} IES files`);
}
console.log(`${checked} checks, ${failed} failed`);
process.exit(failed > 0 || checked === 0 ? 1 : 0);
