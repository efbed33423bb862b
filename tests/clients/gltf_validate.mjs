// Khronos validator over the files named on the command line: prints one JSON object per file, path and messages.
// Run with the folder that holds node_modules/gltf-validator as first argument.
import { createRequire } from 'node:module';
import { readFileSync } from 'node:fs';
import { dirname, join } from 'node:path';

const [clients, ...files] = process.argv.slice(2);
const validator = createRequire(join(clients, 'package.json'))('gltf-validator');

for (const file of files) {
  const report = await validator.validateBytes(new Uint8Array(readFileSync(file)), {
    uri: file,
    maxIssues: 0,
    externalResourceFunction: async (uri) => new Uint8Array(readFileSync(join(dirname(file), decodeURIComponent(uri)))),
  });
  const { numErrors, numWarnings, messages } = report.issues;
  console.log(JSON.stringify({ file, errors: numErrors, warnings: numWarnings, messages }));
}
