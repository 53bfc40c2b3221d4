// Khronos validation of glTF files: node tools/validate_glb.mjs FILE.glb [FILE.glb ...]
//
// Resolves `gltf-validator` from the node_modules of the current folder (npm install gltf-validator).
// Prints one line of counts a file and its issues; exit code 1 when there is an error or a warning.
import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { join } from "node:path";

const require = createRequire(join(process.cwd(), "anchor.js"));
const validator = require("gltf-validator");

let clean = true;
for (const path of process.argv.slice(2)) {
  const report = await validator.validateBytes(new Uint8Array(readFileSync(path)), {
    uri: path,
    maxIssues: 200,
  });
  const { numErrors, numWarnings, numInfos, numHints, messages } = report.issues;
  console.log(`${path}: errors ${numErrors} warnings ${numWarnings} infos ${numInfos} hints ${numHints}`);
  for (const issue of messages.slice(0, 20)) {
    console.log(`  ${issue.code} ${issue.pointer ?? ""} ${issue.message}`);
  }
  clean &&= numErrors === 0 && numWarnings === 0;
}
process.exit(clean ? 0 : 1);
