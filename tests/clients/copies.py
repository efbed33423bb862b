"""What Blender makes of copies and of the sky: copies.py FILE.usda EXPECTED.json

Runs under bpy (5.0). Imports into the factory file, counts objects, armatures and materials, follows the instances of the
evaluated scene at two frames and reads the picture of the World. Prints one JSON object; the caller holds it to what it wants.
EXPECTED: {"places": [[x, y, z], ...] of copies in osier's space, "sky": [[u, v], ...] of the picture, "copies": output of
skinned_copies.py, or nothing}.
"""
import json
import resource
import sys
import time

import bpy
import numpy
from mathutils import Vector

path, wanted = sys.argv[-2:]
wanted = json.load(open(wanted, encoding="utf-8"))
bpy.ops.wm.read_factory_settings(use_empty=False)
for o in list(bpy.data.objects):
    bpy.data.objects.remove(o)
start, used = time.time(), time.process_time()
bpy.ops.wm.usd_import(filepath=path)
# On a machine that does other things too, the processor's time of all threads; on a quiet one, the time that passes.
seconds = min(time.time() - start, time.process_time() - used)

scene = bpy.context.scene
frames = [scene.frame_start, (scene.frame_start + scene.frame_end) // 2]
stands, tips = [], []


def highest(o):
    """The highest vertex of an object's evaluated mesh, in its own space."""
    points = numpy.empty(3 * len(o.data.vertices), numpy.float32)
    o.data.vertices.foreach_get("co", points)
    points = points.reshape(-1, 3)
    return Vector(points[points[:, 2].argmax()].tolist())


for number in frames:
    scene.frame_set(number)
    graph = bpy.context.evaluated_depsgraph_get()
    roots, reach = [], []
    for i in graph.object_instances:
        if not i.is_instance or i.object.type != "MESH" or not i.object.name.startswith("bark"):
            continue
        m = i.matrix_world
        # Blender space to osier's.
        roots.append([m.translation[0], m.translation[2], -m.translation[1]])
        if len(reach) < 50:
            reach.append(list(m @ highest(i.object)))
    stands.append(roots)
    tips.append(reach)


def tip_distance(copies):
    """Largest distance of the tips of copies from where they are expected, at the frames for which they are."""
    far = 0.0
    for number in copies[0]["points"]:
        scene.frame_set(int(number))
        places = numpy.array([c["place"] for c in copies])
        wanted = [numpy.array(c["points"][number]) for c in copies]
        off = [numpy.inf] * len(copies)
        for i in bpy.context.evaluated_depsgraph_get().object_instances:
            if not i.is_instance or i.object.type != "MESH" or not i.object.name.startswith("bark"):
                continue
            x, y, z = i.matrix_world.translation
            away = numpy.linalg.norm(places - (x, z, -y), axis=1)
            k = int(away.argmin())
            tip = int(wanted[k][:, 1].argmax())
            if away[k] < 1e-3 and len(i.object.data.vertices) == len(wanted[k]):
                x, y, z = i.matrix_world @ i.object.data.vertices[tip].co
                off[k] = min(off[k], float(numpy.linalg.norm(wanted[k][tip] - (x, z, -y))))
        far = max(far, *off)
    return far


def nearest(p):
    return min(sum((a - b) ** 2 for a, b in zip(p, q)) ** 0.5 for q in stands[0])


def moved(a, b):
    return max(sum((x - y) ** 2 for x, y in zip(p, q)) ** 0.5 for p, q in zip(a, b))


world = scene.world
nodes = world.node_tree.nodes if world and world.node_tree else []
images = [n.image for n in nodes if n.type == "TEX_ENVIRONMENT" and n.image]
sky = []
if images:
    width, height = images[0].size
    pixels = images[0].pixels
    for u, v in wanted.get("sky", []):
        # Blender counts rows from the bottom.
        x, y = int(u * width), int((1.0 - v) * height)
        at = 4 * (y * width + x)
        sky.append(list(pixels[at:at + 3]))
print(json.dumps({
    "seconds": seconds,
    "gigabytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6,
    "objects": len(bpy.data.objects),
    "armatures": len(bpy.data.armatures),
    "meshes": len(bpy.data.meshes),
    "materials": len(bpy.data.materials),
    "copies": [len(s) for s in stands],
    "off": max((nearest(p) for p in wanted["places"]), default=0.0),
    "moved": [moved(tips[0], t) for t in tips[1:]],
    "tips": tip_distance(wanted["copies"]) if wanted.get("copies") else 0.0,
    "environment": len(images),
    "sky": sky,
}))
