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
    # All faces are triangles, so that every three corners are one.
    corners = np.empty(len(mesh.loops), dtype=np.int32)
    mesh.loops.foreach_get("vertex_index", corners)
    assert 3 * len(mesh.polygons) == len(corners)
    objects[0].evaluated_get(dependencies).to_mesh_clear()
    return len(objects), points.reshape(-1, 3), corners.reshape(-1, 3)


def seen(points, triangles):
    """Which points belong to a face that has an area: others are not born yet or have fallen."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    shown = np.zeros(len(points), dtype=bool)
    shown[triangles[areas > 1e-8]] = True
    return shown


def main():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.wm.usd_import(filepath=sys.argv[1])
    frames = []
    before, shown_before = None, None
    for number in map(int, sys.argv[2:]):
        bpy.context.scene.frame_set(number)
        dependencies = bpy.context.evaluated_depsgraph_get()
        objects, points, triangles = bark_points(dependencies)
        shown = seen(points, triangles)
        sizes = [i.matrix_world.col[0].length for i in dependencies.object_instances if i.is_instance]
        moved = 0.0
        if before is not None and (shown & shown_before).any():
            moved = float(np.linalg.norm(points - before, axis=1)[shown & shown_before].max())
        before, shown_before = points, shown
        frames.append(
            {
                "barks": objects,
                "points": len(points),
                "topology": hash(triangles.tobytes()),
                "height": float(points.max(axis=0)[1] if points.size else 0.0),
                "extent": float(np.linalg.norm(points.max(axis=0) - points.min(axis=0))),
                "moved": moved,
                "leaves": len(sizes),
                "size": float(np.mean(sizes)) if sizes else 0.0,
            }
        )
    print(json.dumps(frames))


main()
