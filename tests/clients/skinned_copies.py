"""Where usd-core puts copies of plants: skinned_copies.py MANIFEST COUNT FRAME...

Skins the mesh `bark` of the asset of every COUNT-th part of the placements at the frames, each at the time of its placement, and places
it. Prints one JSON list: for each copy its `place` and by frame its `points`, in the axes of the scene, in metres.
"""
import json
import pathlib
import struct
import sys

import numpy as np
from pxr import Usd, UsdGeom, UsdSkel

manifest = pathlib.Path(sys.argv[1])
count, frames = int(sys.argv[2]), [int(f) for f in sys.argv[3:]]
told = json.loads(manifest.read_text())
clip = told["time"]
span = clip["loop"] or clip["end"] - clip["start"] + 1
plants = {i: asset for i, asset in enumerate(told["assets"]) if asset["kind"] == "plant"}
copies_of_plants = [row for row in struct.iter_unpack("<10f", (manifest.parent / told["places"]).read_bytes()) if int(row[0]) in plants]


def skinned(asset, time):
    """Points of the bark of an asset at a time of its clip."""
    stage = Usd.Stage.Open(str(manifest.parent / plants[asset]["files"][0]))
    mesh = next(p for p in stage.Traverse() if p.GetName() == "bark" and p.IsA(UsdGeom.Mesh))
    root, cache = UsdSkel.Root.Find(mesh), UsdSkel.Cache()
    assert cache.Populate(root, Usd.PrimDefaultPredicate)
    for binding in cache.ComputeSkelBindings(root, Usd.PrimDefaultPredicate):
        query = cache.GetSkelQuery(binding.GetSkeleton())
        for target in (t for t in binding.GetSkinningTargets() if t.GetPrim() == mesh):
            points = UsdGeom.Mesh(mesh).GetPointsAttr().Get()
            assert target.ComputeSkinnedPoints(query.ComputeSkinningTransforms(time), points, time)
            to_world = np.array(UsdGeom.Imageable(binding.GetSkeleton().GetPrim()).ComputeLocalToWorldTransform(time))
            return np.array(points, float) @ to_world[:3, :3] + to_world[3, :3]
    raise AssertionError(f"{mesh.GetPath()} is not skinned")


def turn(x, y, z, w):
    """The matrix of a quaternion, for columns."""
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])


copies = []
for row in copies_of_plants[:: len(copies_of_plants) // count][:count]:
    asset, offset, *rest = row
    position, rotation, scale = np.array(rest[:3]), turn(*rest[3:7]), rest[7]
    points = {}
    for frame in frames:
        time = clip["start"] + (frame - clip["start"] + offset) % span
        points[frame] = (scale * (skinned(int(asset), Usd.TimeCode(time)) @ rotation.T) + position).tolist()
    copies.append({"place": position.tolist(), "offset": offset, "asset": plants[int(asset)]["id"], "points": points})
print(json.dumps(copies))
