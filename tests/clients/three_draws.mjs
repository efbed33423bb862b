// Draw calls that three.js makes for glTF files when all of each is in view.
// Arguments: the folder that holds node_modules/three, then files. Prints {"draws", "instanced", "skinned"} for each: a call for
// every mesh, line and point cloud of the loaded scene, an InstancedMesh with all of its instances being one. Fails on any
// warning of the loader.
import { readFileSync } from 'node:fs';
import { join } from 'node:path';
import { pathToFileURL } from 'node:url';

const [clients, ...files] = process.argv.slice(2);
const complaints = [];
for (const level of ['warn', 'error']) console[level] = (...words) => complaints.push(words.join(' '));

// What a browser has and pictures need; their pixels play no part here.
globalThis.self = globalThis;
globalThis.createImageBitmap = async () => ({ width: 1, height: 1, close() {} });

const three = join(clients, 'node_modules/three');
const { GLTFLoader } = await import(pathToFileURL(join(three, 'examples/jsm/loaders/GLTFLoader.js')));
for (const file of files) {
  const bytes = readFileSync(file);
  const data = bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.byteLength);
  const gltf = await new GLTFLoader().parseAsync(data, '');
  const seen = { draws: 0, instanced: 0, skinned: 0 };
  gltf.scene.traverse((o) => {
    if (!(o.isMesh || o.isLine || o.isPoints)) return;
    seen.draws += Array.isArray(o.material) ? o.geometry.groups.length : 1;
    seen.instanced += o.isInstancedMesh ? 1 : 0;
    seen.skinned += o.isSkinnedMesh ? 1 : 0;
  });
  if (complaints.length) throw new Error(`${file}: ${complaints.join('; ')}`);
  process.stdout.write(JSON.stringify(seen) + '\n');
}
