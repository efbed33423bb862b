"""What the displacement of bark does to a trunk in Blender: bark_relief.py FILE.usda LOW HIGH REACH

Opens the file and takes the points of the bark between two heights and within a distance of the origin, m. Prints one JSON object: the
largest distance of these points from their axis, m, before and after their displacement as the imported material has it.
"""
import json
import sys

import bpy
import numpy as np

path, low, high, REACH = sys.argv[1], *map(float, sys.argv[2:5])
bpy.ops.wm.read_factory_settings(use_empty=True)
assert bpy.ops.wm.usd_import(filepath=path) == {"FINISHED"}
bark = next(o for o in bpy.data.objects if o.type == "MESH" and o.name.startswith("bark"))
mesh = bark.data


def of_vertices(items, name, width):
    values = np.empty(width * len(items), np.float32)
    items.foreach_get(name, values)
    return values.reshape(-1, width)


points = of_vertices(mesh.vertices, "co", 3)
normals = of_vertices(mesh.vertices, "normal", 3)
corners = np.empty(len(mesh.loops), np.int64)
mesh.loops.foreach_get("vertex_index", corners)
uv = np.zeros((len(points), 2))
uv[corners] = of_vertices(mesh.uv_layers[0].data, "uv", 2)
# The stage's up axis is Y in the object's space; its transform turns it to Z.
world = np.array(bark.matrix_world)
stands = points @ world[:3, :3].T + world[:3, 3]
stem = (stands[:, 2] > low) & (stands[:, 2] < high) & (np.hypot(stands[:, 0], stands[:, 1]) < REACH)

material = next(m for m in mesh.materials if m.name.endswith("bark"))
node = next(n for n in material.node_tree.nodes if n.type == "DISPLACEMENT")
image = next(n.image for n in material.node_tree.nodes if n.type == "TEX_IMAGE" and "height" in n.image.name)
width, height = image.size
pixels = np.empty(4 * width * height, np.float32)
image.pixels.foreach_get(pixels)
pixels = pixels.reshape(height, width, 4)
at = np.floor((uv % 1.0) * [width, height]).astype(int) % [width, height]
values = pixels[at[:, 1], at[:, 0], 0]
moved = (values - node.inputs["Midlevel"].default_value) * node.inputs["Scale"].default_value
displaced = points + normals * moved[:, None]
displaced = displaced @ world[:3, :3].T + world[:3, 3]


def radius(p):
    middle = 0.5 * (stands[stem].min(axis=0) + stands[stem].max(axis=0))
    return float(np.hypot(*(p[stem] - middle)[:, :2].T).max())


print(json.dumps({
    "points": int(stem.sum()), "before": radius(stands), "after": radius(displaced), "method": material.displacement_method,
    "scale": node.inputs["Scale"].default_value, "midlevel": node.inputs["Midlevel"].default_value,
    "heights": [float(values[stem].min()), float(values[stem].max())],
}))
