// Loads glTF files headless with three.js and with Babylon.js and counts what each would draw.
// Arguments: the folder that holds node_modules, then files. Prints for each file one line of JSON:
// {"file", "three": {"triangles", "instances", "skinned", "joints", "channels"}, "babylon": {...}}. Triangles count every instance;
// `channels` is the number of meshes with vertex colours. Fails on any warning of a loader.
import { readFileSync } from 'node:fs';
import { join } from 'node:path';
import { pathToFileURL } from 'node:url';

const [clients, ...files] = process.argv.slice(2);
const complaints = [];
for (const level of ['warn', 'error']) console[level] = (...words) => complaints.push(words.join(' '));
console.log = () => {};

// What a browser has and pictures need; their pixels play no part here.
globalThis.self = globalThis;
globalThis.createImageBitmap = async () => ({ width: 1, height: 1, close() {} });

const load = (path) => import(pathToFileURL(join(clients, 'node_modules', path)));
const THREE = await load('three/build/three.module.js');
const { GLTFLoader } = await load('three/examples/jsm/loaders/GLTFLoader.js');
const { MeshoptDecoder } = await load('three/examples/jsm/libs/meshopt_decoder.module.js');
const { NullEngine } = await load('@babylonjs/core/Engines/nullEngine.js');
const { Scene } = await load('@babylonjs/core/scene.js');
const { ImportMeshAsync } = await load('@babylonjs/core/Loading/sceneLoader.js');
const { MeshoptCompression } = await load('@babylonjs/core/Meshes/Compression/meshoptCompression.js');
await load('@babylonjs/loaders/glTF/2.0/index.js');

// In a browser Babylon.js fetches the decoder of meshopt; here it gets the one that is installed.
await MeshoptDecoder.ready;
Object.defineProperty(MeshoptCompression, 'Default', {
  get: () => ({
    async decodeGltfBufferAsync(source, count, stride, mode, filter) {
      const result = new Uint8Array(count * stride);
      MeshoptDecoder.decodeGltfBuffer(result, count, stride, source, mode, filter);
      return result;
    },
  }),
});

async function countThree(bytes) {
  const data = bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.byteLength);
  const gltf = await new GLTFLoader().setMeshoptDecoder(MeshoptDecoder).parseAsync(data, '');
  const seen = { triangles: 0, instances: 0, skinned: 0, joints: 0, channels: 0 };
  gltf.scene.traverse((o) => {
    if (!o.isMesh) return;
    const copies = o.isInstancedMesh ? o.count : 1;
    seen.triangles += (o.geometry.index.count / 3) * copies;
    seen.instances += o.isInstancedMesh ? o.count : 0;
    seen.skinned += o.isSkinnedMesh ? 1 : 0;
    if (o.isSkinnedMesh) seen.joints = Math.max(seen.joints, o.skeleton.bones.length);
    seen.channels += o.geometry.getAttribute('color') ? 1 : 0;
  });
  return seen;
}

async function countBabylon(bytes) {
  const engine = new NullEngine();
  const scene = new Scene(engine);
  const source = `data:application/octet-stream;base64,${bytes.toString('base64')}`;
  await ImportMeshAsync(source, scene, { pluginExtension: '.glb' });
  const seen = { triangles: 0, instances: 0, skinned: 0, joints: 0, channels: 0 };
  for (const mesh of scene.meshes) {
    if (mesh.getTotalIndices() === 0) continue;
    const copies = mesh.hasThinInstances ? mesh.thinInstanceCount : 1;
    seen.triangles += (mesh.getTotalIndices() / 3) * copies;
    seen.instances += mesh.hasThinInstances ? copies : 0;
    seen.skinned += mesh.skeleton ? 1 : 0;
    if (mesh.skeleton) seen.joints = Math.max(seen.joints, mesh.skeleton.bones.length);
    seen.channels += mesh.isVerticesDataPresent('color') ? 1 : 0;
  }
  scene.dispose();
  engine.dispose();
  return seen;
}

for (const file of files) {
  const bytes = readFileSync(file);
  const line = { file, three: await countThree(bytes), babylon: await countBabylon(bytes) };
  if (complaints.length) throw new Error(`${file}: ${complaints.join('; ')}`);
  process.stdout.write(`${JSON.stringify(line)}\n`);
}
