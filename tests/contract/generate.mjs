// `generate.mjs CONTRACT OUT`: types of the contract. Bytes are a Blob, as openapi-typescript's manual has it.
import { writeFileSync } from "node:fs";
import { pathToFileURL } from "node:url";
import openapiTS, { astToString } from "openapi-typescript";
import ts from "typescript";

const [contract, out] = process.argv.slice(2);
const blob = ts.factory.createTypeReferenceNode(ts.factory.createIdentifier("Blob"));
const types = await openapiTS(pathToFileURL(contract), {
  transform: (schema) => (schema.format === "binary" ? blob : undefined),
});
writeFileSync(out, astToString(types));
