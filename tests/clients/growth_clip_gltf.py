"""Opens the glTF and the USD of a growth clip in Blender and compares, frame by frame, what both show.

python growth_clip_gltf.py FILE.glb FILE.usda START FPS FRAME...
Prints one list: for each frame the names of the meshes of the glTF, how far the points of the bark that USD shows are from the nearest ones that
glTF shows (m: 95 of 100 points and the farthest; and the reverse), and the numbers of leaves of both.
"""

import json
import sys

import bpy
import numpy as np
from mathutils import kdtree


def evaluated(graph, source):
    """Points in space of the world, n x 3, and triangles, m x 3."""
    mesh = source.evaluated_get(graph).to_mesh()
    points = np.empty(3 * len(mesh.vertices), dtype=np.float32)
    mesh.vertices.foreach_get("co", points)
    mesh.calc_loop_triangles()
    triangles = np.empty(3 * len(mesh.loop_triangles), dtype=np.int32)
    mesh.loop_triangles.foreach_get("vertices", triangles)
    source.evaluated_get(graph).to_mesh_clear()
    world = np.array(source.matrix_world)
    return points.reshape(-1, 3) @ world[:3, :3].T + world[:3, 3], triangles.reshape(-1, 3)


def shown(points, triangles, least):
    """Triangles of which twice the area is above a least one, m^2."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return triangles[np.linalg.norm(np.cross(b - a, c - a), axis=1) > least]


def seen(points, triangles):
    """Points of triangles that can be seen: of a shoot of 0.1 m, those wider than a tenth of a millimetre.

    Branches that have died thin out to threads, which the shapes of glTF may leave out a frame earlier or later than USD.
    """
    return points[np.unique(shown(points, triangles, 1e-5))]


def distances(points, others):
    """Distances of the points from the nearest of the others: that which 95 of 100 keep, and the largest."""
    tree = kdtree.KDTree(len(others))
    for i, p in enumerate(others):
        tree.insert(p, i)
    tree.balance()
    return list(np.quantile([tree.find(p)[2] for p in points], [0.95, 1.0]))


def main():
    glb, stage, start, fps = sys.argv[1], sys.argv[2], int(sys.argv[3]), int(sys.argv[4])
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.fps = fps
    bpy.ops.import_scene.gltf(filepath=glb)
    ours = [o for o in bpy.data.objects if o.type == "MESH"]
    bpy.ops.wm.usd_import(filepath=stage)
    theirs = [o for o in bpy.data.objects if o.type == "MESH" and o not in ours and o.name.startswith("bark")]
    frames = []
    for number in map(int, sys.argv[5:]):
        # glTF has the first frame at 0 s, USD has numbers.
        scene.frame_set(number - start)
        graph = bpy.context.evaluated_depsgraph_get()
        bark = seen(*evaluated(graph, next(o for o in ours if "bark" in o.name)))
        leaves, triangles = evaluated(graph, next(o for o in ours if "leaves" in o.name))
        blades = shown(leaves, triangles, 1e-9)
        scene.frame_set(number)
        graph = bpy.context.evaluated_depsgraph_get()
        wanted = seen(*evaluated(graph, theirs[0]))
        sizes = [i.matrix_world.to_scale()[0] for i in graph.object_instances if i.is_instance]
        frames.append(
            {
                "meshes": sorted(o.name for o in ours),
                "missing": distances(wanted, bark),
                "beyond": distances(bark, wanted),
                "leaves": sum(size > 1e-4 for size in sizes),
                "blades": len(np.unique(blades[:, 0] // 4)),
            }
        )
    print(json.dumps(frames))


main()
