"""Opens the USD of a growth clip in Blender and prints, frame by frame, what is there.

python growth_clip.py FILE.usda FRAME...
"""

import json
import sys

import bpy
import numpy as np


def bark_points(dependencies):
    """Points of the one object that is bark, in its own space."""
    objects = [o for o in bpy.data.objects if o.type == "MESH" and o.name.startswith("bark")]
    mesh = objects[0].evaluated_get(dependencies).to_mesh()
    points = np.empty(3 * len(mesh.vertices), dtype=np.float32)
    mesh.vertices.foreach_get("co", points)
    triangles = [tuple(p.vertices) for p in mesh.polygons]
    objects[0].evaluated_get(dependencies).to_mesh_clear()
    return len(objects), points.reshape(-1, 3), hash(tuple(triangles))


def main():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.wm.usd_import(filepath=sys.argv[1])
    frames = []
    before = None
    for number in map(int, sys.argv[2:]):
        bpy.context.scene.frame_set(number)
        dependencies = bpy.context.evaluated_depsgraph_get()
        objects, points, topology = bark_points(dependencies)
        sizes = [i.matrix_world.to_scale()[0] for i in dependencies.object_instances if i.is_instance]
        moved = 0.0 if before is None else float(np.linalg.norm(points - before, axis=1).max())
        before = points
        frames.append(
            {
                "barks": objects,
                "points": len(points),
                "topology": topology,
                "height": float(points.max(axis=0)[1] if points.size else 0.0),
                "extent": float(np.linalg.norm(points.max(axis=0) - points.min(axis=0))),
                "moved": moved,
                "leaves": len(sizes),
                "size": float(np.mean(sizes)) if sizes else 0.0,
            }
        )
    print(json.dumps(frames))


main()
