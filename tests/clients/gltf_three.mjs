// Loads glTF files with three.js and compares what it shows with what osier expects.
// Arguments: the folder that holds node_modules/three, and a JSON file with jobs as in blender_gltf.py.
// Fails on any warning of the loader, on positions beyond 1e-4 m, and unless every node with instancing became one
// InstancedMesh. Prints the largest distance of each job.
import { readFileSync } from 'node:fs';
import { join } from 'node:path';
import { pathToFileURL } from 'node:url';

const [clients, jobs] = process.argv.slice(2);
const complaints = [];
for (const level of ['warn', 'error']) console[level] = (...words) => complaints.push(words.join(' '));

// What a browser has and pictures need; their pixels play no part here.
globalThis.self = globalThis;
globalThis.createImageBitmap = async () => ({ width: 1, height: 1, close() {} });

const three = join(clients, 'node_modules/three');
const THREE = await import(pathToFileURL(join(three, 'build/three.module.js')));
// The loader imports three by its bare name, which resolves beside it.
const { GLTFLoader } = await import(pathToFileURL(join(three, 'examples/jsm/loaders/GLTFLoader.js')));

const { MeshoptDecoder } = await import(pathToFileURL(join(three, 'examples/jsm/libs/meshopt_decoder.module.js')));

function positions(mesh) {
  const out = [];
  const count = mesh.geometry.getAttribute('position').count;
  const placed = (matrix) => {
    for (let i = 0; i < count; i++) {
      const p = new THREE.Vector3();
      mesh.getVertexPosition ? mesh.getVertexPosition(i, p) : p.fromBufferAttribute(mesh.geometry.attributes.position, i);
      out.push(p.applyMatrix4(matrix));
    }
  };
  if (!mesh.isInstancedMesh) {
    placed(mesh.matrixWorld);
    return out;
  }
  for (let k = 0; k < mesh.count; k++) {
    const local = new THREE.Matrix4();
    mesh.getMatrixAt(k, local);
    placed(local.premultiply(mesh.matrixWorld));
  }
  return out;
}

// The meshes of a node: itself, or one child for each primitive. The loader keeps the node's name in userData.
function meshesOf(gltf, name) {
  const found = [];
  gltf.scene.traverse((o) => {
    if (o.userData.name !== name) return;
    for (const each of o.isMesh ? [o] : o.children) if (each.isMesh) found.push(each);
  });
  return found;
}

// Largest distance along an axis between lists of points; in any order, that of each point to the nearest of the other list.
function distance(got, want, anyOrder) {
  const all = want.map((p) => new THREE.Vector3(...p));
  const apart = (p, q) => Math.max(Math.abs(p.x - q.x), Math.abs(p.y - q.y), Math.abs(p.z - q.z));
  if (!anyOrder) return Math.max(...got.map((p, i) => apart(p, all[i])));
  const nearest = (p, list) => Math.min(...list.map((q) => apart(p, q)));
  return Math.max(...got.map((p) => nearest(p, all)), ...all.map((p) => nearest(p, got)));
}

function compare(got, want, where, { bound = 1e-4, any_order: anyOrder = false }) {
  if (want.hidden) {
    const far = Math.max(...got.map((p) => p.distanceTo(got[0])));
    if (far > 1e-4) throw new Error(`${where} is dead but spans ${far} m`);
    return 0;
  }
  let list = got;
  if (want.pairs) {
    // Vertices beside a curve come in pairs; in another order there is no telling which.
    if (anyOrder) return 0;
    list = got.filter((_, i) => i % 2 === 0).map((p, i) => p.clone().add(got[2 * i + 1]).multiplyScalar(0.5));
  }
  if (list.length !== want.points.length) throw new Error(`${where}: ${list.length} vertices, not ${want.points.length}`);
  const worst = distance(list, want.points, anyOrder);
  if (!(worst < bound)) throw new Error(`${where} is off by ${worst} m`);
  return worst;
}

for (const job of JSON.parse(readFileSync(jobs, 'utf8'))) {
  const bytes = readFileSync(job.file);
  const gltf = await new GLTFLoader().setMeshoptDecoder(MeshoptDecoder).parseAsync(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length), '');
  const { nodes } = gltf.parser.json;
  let instanced = 0;
  gltf.scene.traverse((o) => (instanced += o.isInstancedMesh ? 1 : 0));
  const wanted = nodes.filter((n) => n.extensions?.EXT_mesh_gpu_instancing).length;
  if (instanced !== wanted) throw new Error(`${job.file}: ${instanced} InstancedMesh for ${wanted} instancing nodes`);

  const mixer = new THREE.AnimationMixer(gltf.scene);
  for (const clip of gltf.animations) {
    const action = mixer.clipAction(clip);
    action.setLoop(THREE.LoopOnce);
    action.clampWhenFinished = true;
    action.play();
  }
  let worst = 0;
  for (const [number, objects] of Object.entries(job.frames)) {
    // Keys hold f32 seconds: a step at this frame must have happened.
    mixer.setTime(Math.fround((Number(number) - job.start) / job.fps));
    gltf.scene.updateMatrixWorld(true);
    for (const [name, want] of Object.entries(objects)) {
      const where = `${job.file}, frame ${number}: ${name}`;
      const got = meshesOf(gltf, name).flatMap(positions);
      worst = Math.max(worst, compare(got, want, where, job));
    }
  }
  if (complaints.length) throw new Error(`${job.file}: ${complaints.join('; ')}`);
  process.stdout.write(`${JSON.stringify({ file: job.file, worst, instanced })}\n`);
}
