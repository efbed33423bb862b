"""What Blender shows of a baked scene: showcase.py usd|gltf FILE EXPECTED.json

Runs under bpy (5.0) and under Blender 3.4 headless; arguments are the last three. Number, box and middle of the world
positions of every mesh's vertices (or each of them, where "points" are given) and every instancer's pivots at every
expected frame equal osier's within 1e-4 m, and exactly the expected materials are in use. Prints the largest distance.
"""
import json
import sys

import numpy

if not hasattr(numpy, "bool"):
    # The importer of Blender 3.4 uses the alias that numpy 1.24 dropped.
    numpy.bool = bool

import bpy  # noqa: E402

TOLERANCE = 1e-4
kind, path, wanted = sys.argv[-3:]
wanted = json.load(open(wanted, encoding="utf-8"))[kind]


def base(o):
    return o.name.split(".")[0]


def placement(o):
    while o.parent and o.parent.parent:
        o = o.parent
    return base(o)


def index():
    """Objects by PLACEMENT/NAME and kind: thousands, so they are sorted once."""
    out = {}
    for o in bpy.data.objects:
        out.setdefault((f"{placement(o)}/{base(o)}", o.type), []).append(o)
    return out


def alone(key, kind):
    """Blender makes one object of a placement and its only mesh."""
    single = [o for o in bpy.data.objects if o.type == kind and (o.parent is None or o.parent.parent is None)]
    return [o for o in single if base(o) in key.split("/")]


def find(key, kind, want=None, graph=None):
    """An object by its name, or by the name of its placement and its own: PLACEMENT/NAME.

    Blender drops the name of a placement whose only child is a mesh or a SkelRoot, and keeps the child's: of several such objects the
    one whose vertices are nearest to what is wanted is taken, and compared like all others.
    """
    if "/" not in key:
        return bpy.data.objects[key]
    hits = objects.get((key, kind), []) or objects.get((f"skel/{key.split('/')[1]}", kind), []) or alone(key, kind)
    if len(hits) > 1 and want:
        off = numpy.abs(means(hits, graph) - numpy.array(want["mean"])).max(axis=1)
        hits = [hits[int(off.argmin())]]
    assert len(hits) == 1, (key, hits)
    return hits[0]


def ours(points):
    """Blender space to osier's."""
    return numpy.stack([points[:, 0], points[:, 2], -points[:, 1]], axis=1)


def vertices(o, graph):
    """World positions of an object's evaluated vertices, n x 3."""
    o = o.evaluated_get(graph)
    local = numpy.empty(3 * len(o.data.vertices), numpy.float32)
    o.data.vertices.foreach_get("co", local)
    world = numpy.array(o.matrix_world, dtype=float)
    return ours(local.reshape(-1, 3) @ world[:3, :3].T + world[:3, 3])


seen = {}


def means(hits, graph):
    """Means of the world positions of objects' vertices at the present frame, n x 3: many keys find the same hundreds of objects."""
    at = (bpy.context.scene.frame_current, *(o.name for o in hits))
    if at not in seen:
        seen[at] = numpy.array([vertices(o, graph).mean(axis=0) for o in hits])
    return seen[at]


def pivots(graph):
    """World positions of all instances by the object that shows them."""
    out = {}
    for i in graph.object_instances:
        if i.is_instance and i.object.type == "MESH":
            out.setdefault(i.parent.original.name, []).append(i.matrix_world.translation[:])
    return {name: ours(numpy.array(list_, dtype=float)) for name, list_ in out.items()}


def copies(graph):
    """World positions of the vertices of collections that placements share, by PLACEMENT/NAME."""
    out, local = {}, {}
    for i in graph.object_instances:
        if not i.is_instance or i.parent.type != "EMPTY" or i.object.type != "MESH":
            continue
        name = i.object.original.name
        if name not in local:
            points = numpy.empty(3 * len(i.object.data.vertices), numpy.float32)
            i.object.data.vertices.foreach_get("co", points)
            local[name] = points.reshape(-1, 3)
        world = numpy.array(i.matrix_world, dtype=float)
        key = f"{base(i.parent.original)}/{name.split('.')[0]}"
        out[key] = ours(local[name] @ world[:3, :3].T + world[:3, 3])
    return out


def close(points, want, where):
    assert len(points) == want["count"], f"{where}: {len(points)}, not {want['count']}"
    if not len(points):
        return 0.0
    if "points" in want:
        error = float(numpy.abs(points - numpy.array(want["points"])).max())
        assert error <= TOLERANCE, f"{where}: a vertex is off by {error} m"
        return error
    got = numpy.array([points.min(axis=0), points.max(axis=0), points.mean(axis=0)])
    error = float(numpy.abs(got - numpy.array([want["min"], want["max"], want["mean"]])).max())
    assert error <= TOLERANCE, f"{where}: off by {error} m\n got {got}\nwant {want}"
    return error


bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene
shift = 0
if kind == "usd":
    assert bpy.ops.wm.usd_import(filepath=path) == {"FINISHED"}
    assert (scene.frame_start, scene.frame_end) == (wanted["start"], wanted["end"]), (scene.frame_start, scene.frame_end)
else:
    scene.render.fps = round(wanted["fps"])
    assert bpy.ops.import_scene.gltf(filepath=path) == {"FINISHED"}
    shift = wanted["start"]  # glTF knows no frame numbers, only seconds from the first

worst = 0.0
objects = index()
for number, frame in wanted["frames"].items():
    scene.frame_set(int(number) - shift)
    graph = bpy.context.evaluated_depsgraph_get()
    shared = copies(graph)
    without_skin = 0
    for key, want in frame["meshes"].items():
        if want.get("copy") and key not in bpy.data.objects:
            without_skin += 1
            continue
        if key in shared:
            worst = max(worst, close(shared[key], want, f"{key}, frame {number}"))
            continue
        worst = max(worst, close(vertices(find(key, "MESH", want, graph), graph), want, f"{key}, frame {number}"))
    assert without_skin == wanted.get("without_skin", 0), (without_skin, wanted.get("without_skin", 0))
    shown = pivots(graph)
    for key, want in frame["instancers"].items():
        got = shown.get(find(key, "POINTCLOUD").name, numpy.empty((0, 3)))
        worst = max(worst, close(got, want, f"{key}, frame {number}"))

used = set()
for o in bpy.data.objects:
    used |= {s.material.name.split(".")[0] for s in o.material_slots if s.material}
assert used == set(wanted["materials"]), (sorted(used), wanted["materials"])
kinds = [o.type for o in bpy.data.objects]
assert "CAMERA" in kinds, kinds
print(json.dumps({"file": path, "worst": worst, "objects": len(kinds), "materials": len(used)}), flush=True)
