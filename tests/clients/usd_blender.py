"""What Blender makes of a stage: usd_blender.py STAGE EXPECTED.json

Evaluated world positions of meshes, instances, points and curves at every expected frame equal osier's within 1e-4 m
(instances: plus what half precision quaternions cost), and objects, materials, camera and sun are all there.
"""
import json
import sys

import bpy
import numpy as np

TOLERANCE = 1e-4
HALF = 1e-3

bpy.ops.wm.read_factory_settings()
for o in list(bpy.data.objects):
    bpy.data.objects.remove(o)
assert bpy.ops.wm.usd_import(filepath=sys.argv[1]) == {"FINISHED"}
wanted = json.load(open(sys.argv[2]))
scene = bpy.context.scene
assert (scene.frame_start, scene.frame_end) == (wanted["clip"]["start"], wanted["clip"]["end"])


def base(o):
    return o.name.split(".")[0]


def placement(o):
    while o.parent and o.parent.parent:
        o = o.parent
    return base(o)


def find(key, kind):
    where, name = key.split("/")
    hits = [o for o in bpy.data.objects if base(o) == name and placement(o) == where and o.type == kind]
    if not hits:
        # Blender makes one object of a placement and its only mesh.
        alone = [o for o in bpy.data.objects if o.type == kind and (o.parent is None or o.parent.parent is None)]
        hits = [o for o in alone if base(o) in (where, name)]
    assert len(hits) == 1, (key, hits)
    return hits[0]


def ours(points):
    """Blender space to osier's."""
    points = np.asarray(points, dtype=float).reshape(-1, 3)
    return np.stack([points[:, 0], points[:, 2], -points[:, 1]], 1)


def world(matrix, points):
    m = np.array(matrix)
    return ours(points @ m[:3, :3].T + m[:3, 3])


def vector(collection, name):
    out = np.zeros(len(collection) * 3, dtype=np.float32)
    collection.foreach_get(name, out)
    return out.reshape(-1, 3).astype(float)


def close(got, want, name, frame, tolerance=TOLERANCE):
    want = np.array(want, dtype=float).reshape(-1, 3)
    assert got.shape == want.shape, (name, frame, got.shape, want.shape)
    assert len(want) == 0 or np.abs(got - want).max() <= tolerance, (name, frame, np.abs(got - want).max())


def instances(depsgraph):
    """World vertices of all instances by the object that shows them."""
    out = {}
    for i in depsgraph.object_instances:
        if i.is_instance and i.object.type == "MESH":
            points = world(i.matrix_world, vector(i.object.data.vertices, "co"))
            out.setdefault(i.parent.original, []).append(points)
    return out


for number, frame in wanted["frames"].items():
    scene.frame_set(int(number))
    depsgraph = bpy.context.evaluated_depsgraph_get()

    def evaluated(key, kind):
        o = find(key, kind).evaluated_get(depsgraph)
        return o, o.data

    for key, want in frame["meshes"].items():
        o, data = evaluated(key, "MESH")
        close(world(o.matrix_world, vector(data.vertices, "co")), want, key, number)
    shown = instances(depsgraph)
    for key, want in frame["instancers"].items():
        got = shown.get(find(key, "POINTCLOUD"), [])
        alive = [np.array(w["points"]) for w in want if w["alive"]]
        assert len(got) == len(alive), (key, number, len(got), len(alive))
        for w in alive:
            # Instances of one prototype come together, so each expected one is looked for.
            reach = np.linalg.norm(w - w[0], axis=1).max()
            errors = [np.abs(g - w).max() for g in got if g.shape == w.shape]
            assert min(errors) <= TOLERANCE + HALF * reach, (key, number, min(errors))
    for key, want in frame["points"].items():
        o, data = evaluated(key, "POINTCLOUD")
        close(world(o.matrix_world, vector(data.points, "co")), want["positions"], key, number)
        radius = np.array([p.radius for p in data.points])
        assert np.abs(radius * 2 - np.array(want["widths"])).max() < 1e-6, (key, number)
    for key, want in frame["curves"].items():
        o, data = evaluated(key, "CURVES")
        close(world(o.matrix_world, vector(data.points, "position")), want, key, number)

kinds = {}
for o in bpy.data.objects:
    kinds[o.type] = kinds.get(o.type, 0) + 1
kinds.pop("EMPTY")
# Every placement has its own copy of what it shows: two rigs, each a skinned stem and a pair of prototypes.
assert kinds == {"MESH": 5 + 6, "POINTCLOUD": 4, "CURVES": 1, "ARMATURE": 2, "CAMERA": 1, "LIGHT": 1}, kinds
slots = {}
for o in bpy.data.objects:
    if o.type == "MESH":
        slots.setdefault(base(o), set()).add(tuple(s.material.name.split(".")[0] for s in o.material_slots))
assert slots == {
    "stem": {("bark",)}, "body": {("cache_l0", "bark")}, "plane": {("ground",)}, "pool": {("water",)},
    "p000": {("leaf",)}, "p001": {("leaf",), ("water",)}}, slots
names = sorted(m.name.split(".")[0] for m in bpy.data.materials if m.users)
# A wrapper binds all payloads to one material of each kind; in one layer each asset has its own.
counts = [names.count(kind) for kind in ("bark", "leaf", "water")]
assert counts == ([1, 1, 1] if sys.argv[1].endswith("synthetic.usda") else [3, 3, 2]), names
body = find("cache/body", "MESH").data
assert [p.material_index for p in body.polygons][:3] == [0, 0, 1] and body.polygons[-1].material_index == 1
images = {i.filepath.replace("\\", "/").rsplit("/", 1)[-1] for i in bpy.data.images if i.has_data or i.size[0]}
assert {"bark_color.png", "bark_normal.png", "leaf_color.png"} <= images, images
sun = next(o for o in bpy.data.objects if o.type == "LIGHT").data
assert sun.type == "SUN"
assert abs(sun.energy - 3) < 1e-4, sun.energy
camera = next(o for o in bpy.data.objects if o.type == "CAMERA").data
assert abs(camera.angle_y - 0.6) < 1e-4, camera.angle_y
look = json.loads(sys.argv[3])
for name, axis in (("camera", look["back"]), ("sun", look["sun"])):
    m = np.array(next(o for o in bpy.data.objects if base(o) == name).matrix_world)
    assert np.abs(ours(m[:3, 2]) - np.array(axis)).max() < 1e-4, (name, m)
    if name == "camera":
        assert np.abs(ours(m[:3, 3]) - np.array(look["eye"])).max() < 1e-4, m
        assert np.abs(ours(m[:3, 1]) - np.array(look["up"])).max() < 1e-4, m
