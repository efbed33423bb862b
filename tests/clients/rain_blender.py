"""What Blender makes of drops and wet leaves: rain_blender.py STAGE FRAME...

Prints one line of JSON: per frame the middle of each drop's points by drop_id, in osier's axes, and the mean wetness of each
leaf; and the files that pictures name but that are not there.
"""
import json
import os
import sys

import bpy
import numpy as np

bpy.ops.wm.read_factory_settings()
for o in list(bpy.data.objects):
    bpy.data.objects.remove(o)
assert bpy.ops.wm.usd_import(filepath=sys.argv[1]) == {"FINISHED"}


def values(mesh, name, kind):
    data = mesh.attributes[name].data
    out = np.zeros(len(data), dtype=kind)
    data.foreach_get("value", out)
    return out


def at(frame):
    bpy.context.scene.frame_set(frame)
    graph = bpy.context.evaluated_depsgraph_get()
    seen = {"drops": {}, "wetness": {}}
    for o in bpy.data.objects:
        if o.type != "MESH":
            continue
        now = o.evaluated_get(graph)
        mesh = now.to_mesh()
        if "drop_id" in mesh.attributes:
            points = np.zeros(len(mesh.vertices) * 3)
            mesh.vertices.foreach_get("co", points)
            m = np.array(now.matrix_world)
            points = points.reshape(-1, 3) @ m[:3, :3].T + m[:3, 3]
            points = np.stack([points[:, 0], points[:, 2], -points[:, 1]], 1)
            ids = values(mesh, "drop_id", np.int32)
            assert (values(mesh, "wetness", np.float32) == 1).all()
            for i in np.unique(ids):
                seen["drops"][str(i)] = points[ids == i].mean(0).tolist()
        elif "wetness" in mesh.attributes:
            seen["wetness"][o.name] = float(values(mesh, "wetness", np.float32).mean())
        now.to_mesh_clear()
    return seen


frames = {frame: at(int(frame)) for frame in sys.argv[2:]}
paths = [bpy.path.abspath(i.filepath) for i in bpy.data.images if i.filepath]
print(json.dumps({"frames": frames, "missing": [p for p in paths if not os.path.exists(p)]}))
