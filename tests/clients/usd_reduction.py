"""Compares the leaves of two USD payloads of one plant: the first with fewer time samples, the second with all.
Arguments: the two files, then the length in metres that a pixel covers at the plant. At every frame, prints as one line of JSON
the samples of positions and orientations of each file and, in pixels, by how much the tips of the leaves are apart: the 99th
percentile and the most. Also the least and most sum of the weights of a point of the bark."""
import json
import sys

import numpy as np
from pxr import Usd, UsdGeom, UsdSkel

first, second, pixel = sys.argv[1], sys.argv[2], float(sys.argv[3])
stages = [Usd.Stage.Open(path) for path in (first, second)]


def find(stage):
    return [UsdGeom.PointInstancer(p) for p in stage.Traverse() if p.IsA(UsdGeom.PointInstancer)]


def reach(instancer):
    """The farthest point of each prototype from its origin."""
    stage = instancer.GetPrim().GetStage()
    far = []
    for path in instancer.GetPrototypesRel().GetTargets():
        prims = Usd.PrimRange(stage.GetPrimAtPath(path))
        points = [np.array(UsdGeom.Mesh(p).GetPointsAttr().Get()) for p in prims if p.IsA(UsdGeom.Mesh)]
        far.append(max(np.linalg.norm(p, axis=1).max() for p in points))
    return np.array(far)[np.array(instancer.GetProtoIndicesAttr().Get())]


def turns(instancer, time):
    list_ = instancer.GetOrientationsAttr().Get(time)
    q = np.array([[*v.imaginary, v.real] for v in list_], dtype=float)
    return q / np.linalg.norm(q, axis=1)[:, None]


told = {"samples": [], "p99": 0.0, "most": 0.0}
for a, b in zip(*map(find, stages), strict=True):
    for instancer in (a, b):
        told["samples"].append([
            instancer.GetPositionsAttr().GetNumTimeSamples(),
            instancer.GetOrientationsAttr().GetNumTimeSamples(),
        ])
    far = reach(b) * np.array(b.GetScalesAttr().Get()).max(axis=1)
    for time in range(int(stages[0].GetStartTimeCode()), int(stages[0].GetEndTimeCode()) + 1):
        moved = np.linalg.norm(np.array(a.GetPositionsAttr().Get(time)) - np.array(b.GetPositionsAttr().Get(time)), axis=1)
        dot = np.abs((turns(a, time) * turns(b, time)).sum(axis=1)).clip(0, 1)
        turned = 2 * np.arccos(dot) * far
        for error in (moved, turned):
            told["p99"] = max(told["p99"], float(np.percentile(error, 99)) / pixel)
            told["most"] = max(told["most"], float(error.max()) / pixel)
sums = []
for prim in stages[0].Traverse():
    weights = UsdSkel.BindingAPI(prim).GetJointWeightsPrimvar() if prim.IsA(UsdGeom.Mesh) else None
    if weights and weights.Get():
        sums.append(np.array(weights.Get()).reshape(-1, weights.GetElementSize()).sum(axis=1))
told["weights"] = [float(min(s.min() for s in sums)), float(max(s.max() for s in sums))]
print(json.dumps(told))
