"""How the boughs of a baked plant move: sway_amplitudes.py FILE.usda|FILE.glb [FRAME_STEP]

Runs under bpy (5.0). Evaluates every mesh that moves, and the leaf instances, at every FRAME_STEP-th frame of the clip. A bough is an
island of the bark of at least 0.1 m, whose vertices run from base to tip; its carrier is the bough of lower index nearest to its base.
Prints one JSON object: for each mesh its boughs by order and class of length (30 %), with quantiles of the amplitude and of the tip's
path, and the mean correlation of two boughs by distance. Amplitude: root mean square of the distance of the tip from its mean place, m;
"own": relative to the base of the bough. For each leaf instancer the quantiles of the amplitude.
"""
import json
import sys

import bpy
import numpy as np

path = sys.argv[1]
step = int(sys.argv[2]) if len(sys.argv) > 2 else 1
SHORTEST = 0.1
# Share of a bough's length, from its base, that no other bough is taken to hang on.
FOOT = 0.2
# A class of length ends 30 % above its start; one with fewer boughs says nothing of their spread.
CLASS = 1.3
FEWEST = 8
# Pairs of boughs by distance, in shares of the plant's diagonal.
DISTANCES = [0.0, 0.1, 0.2, 0.4, 10.0]


def evaluated(o, graph):
    """World positions of an object's evaluated vertices, n x 3."""
    o = o.evaluated_get(graph)
    local = np.empty(3 * len(o.data.vertices), np.float32)
    o.data.vertices.foreach_get("co", local)
    world = np.array(o.matrix_world)
    return local.reshape(-1, 3) @ world[:3, :3].T + world[:3, 3]


def islands(mesh):
    """Number of the island of each vertex, in the order of their first vertices."""
    edges = np.empty(2 * len(mesh.edges), np.int64)
    mesh.edges.foreach_get("vertices", edges)
    a, b = edges.reshape(-1, 2).T
    label = np.arange(len(mesh.vertices))
    while True:
        low = np.minimum(label[a], label[b])
        following = label.copy()
        np.minimum.at(following, label[a], low)
        np.minimum.at(following, label[b], low)
        following = following[following]
        if (following == label).all():
            return np.unique(label, return_inverse=True)[1]
        label = following


def boughs(o, rest):
    """First and last vertex, and order, of each bough."""
    label = islands(o.data)
    first = np.unique(label, return_index=True)[1]
    last = len(label) - 1 - np.unique(label[::-1], return_index=True)[1]
    long = np.linalg.norm(rest[last] - rest[first], axis=1) >= SHORTEST
    first, last = first[long], last[long]
    of_long = np.cumsum(long) - 1
    points = np.flatnonzero(long[label])
    owner = of_long[label[points]]
    # The first rings of a bough lie within its carrier, nearer to the bases beside it than the carrier's surface is.
    length = np.linalg.norm(rest[last] - rest[first], axis=1)
    outside = np.linalg.norm(rest[points] - rest[first[owner]], axis=1) > FOOT * length[owner]
    points, owner = points[outside], owner[outside]
    order = []
    for k, base in enumerate(rest[first]):
        before = points[: np.searchsorted(points, first[k])]
        if len(before) == 0:
            order.append(0)
            continue
        nearest = np.argmin(((rest[before] - base) ** 2).sum(axis=1))
        order.append(order[owner[nearest]] + 1)
    return first, last, np.array(order)


def quantiles(v):
    return {f"p{q}": float(np.percentile(v, q)) for q in (10, 50, 90, 100)}


def ratio(v):
    return float(np.percentile(v, 90) / max(np.percentile(v, 50), 1e-9))


def correlation(moves, places, size):
    """Mean correlation of two motions (boughs x frames x 3) and number of pairs, by distance of their tips."""
    norm = np.sqrt((moves**2).sum(axis=(1, 2)))
    alive = norm > 1e-6
    m = (moves[alive] / norm[alive, None, None]).reshape(alive.sum(), -1)
    apart = np.linalg.norm(places[alive, None] - places[None, alive], axis=2) / size
    upper = np.triu_indices(len(m), 1)
    pairs, apart = (m @ m.T)[upper], apart[upper]
    out = []
    for a, b in zip(DISTANCES, DISTANCES[1:]):
        inside = (apart >= a) & (apart < b)
        out.append([float(pairs[inside].mean()) if inside.any() else None, int(inside.sum())])
    return out


def rms(moves):
    return np.sqrt((moves**2).sum(axis=2).mean(axis=0))


bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene
if path.endswith((".glb", ".gltf")):
    assert bpy.ops.import_scene.gltf(filepath=path) == {"FINISHED"}
else:
    assert bpy.ops.wm.usd_import(filepath=path) == {"FINISHED"}
meshes = [o for o in bpy.data.objects if o.type == "MESH" and len(o.data.vertices) > 500]
frames = list(range(scene.frame_start, scene.frame_end + 1, step))
ends, series, size, leaves = {}, {o.name: [] for o in meshes}, {}, {}
for number in frames:
    scene.frame_set(number)
    graph = bpy.context.evaluated_depsgraph_get()
    for o in meshes:
        p = evaluated(o, graph)
        if number == frames[0]:
            ends[o.name] = boughs(o, p)
            size[o.name] = float(np.linalg.norm(p.max(axis=0) - p.min(axis=0)))
        first, last, _ = ends[o.name]
        series[o.name].append(np.stack([p[first], p[last]], axis=1))
    for i in graph.object_instances:
        if i.is_instance and i.object.type == "MESH":
            leaves.setdefault(i.parent.original.name, {}).setdefault(number, []).append(i.matrix_world.translation[:])

result = {"meshes": {}, "leaves": {}}
for o in meshes:
    order = ends[o.name][2]
    s = np.array(series[o.name])  # frames x boughs x (base, tip) x 3
    middle = s.mean(axis=0)
    moves = s - middle
    if np.abs(moves).max() < 1e-4:
        continue
    length = np.linalg.norm(middle[:, 1] - middle[:, 0], axis=1)
    tips, own = moves[:, :, 1], moves[:, :, 1] - moves[:, :, 0]
    travelled = np.linalg.norm(np.diff(s[:, :, 1], axis=0), axis=2).sum(axis=0)
    classes = []
    for k in range(order.max() + 1):
        lengths = np.sort(length[order == k])
        high = lengths[-1] * 1.0001 if len(lengths) else 0.0
        while len(lengths) and high > lengths[0]:
            low = high / CLASS
            chosen = (order == k) & (length > low) & (length <= high)
            if chosen.sum() >= FEWEST:
                classes.append({
                    "order": k, "length": [float(low), float(high)], "count": int(chosen.sum()),
                    "amplitude": quantiles(rms(tips)[chosen]), "ratio": ratio(rms(tips)[chosen]),
                    "own": quantiles(rms(own)[chosen]), "own_ratio": ratio(rms(own)[chosen]),
                    "path": quantiles(travelled[chosen]),
                    "correlation": correlation(tips[:, chosen].transpose(1, 0, 2), middle[chosen, 1], size[o.name]),
                })
            high = low
    result["meshes"][o.name] = {"size": size[o.name], "boughs": len(order), "classes": classes}
for name, of in leaves.items():
    if len({len(v) for v in of.values()}) == 1:
        s = np.array([of[n] for n in frames])
        result["leaves"][name] = {"count": s.shape[1], "amplitude": quantiles(rms(s - s.mean(axis=0)))}
print(json.dumps(result))
