"""Where usd-core puts everything: usd_positions.py STAGE EXPECTED.json [z]

Meshes, skinned points, instances, points and curves at world positions equal the expected ones within 1e-4 m; with
`z` the stage is Z-up and is turned back before the comparison.
"""
import json
import sys

import numpy as np
from pxr import Gf, Usd, UsdGeom, UsdSkel

TOLERANCE = 1e-4
# Instances turn by half precision quaternions: at most this angle, rad, off.
HALF = 1e-3

stage = Usd.Stage.Open(sys.argv[1])
wanted = json.load(open(sys.argv[2]))
up = "Z" if sys.argv[3:] == ["z"] else "Y"
assert UsdGeom.GetStageUpAxis(stage) == up
assert UsdGeom.GetStageMetersPerUnit(stage) == 1
clip = wanted["clip"]
assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (clip["start"], clip["end"])
assert stage.GetFramesPerSecond() == stage.GetTimeCodesPerSecond() == clip["fps"]
root = stage.GetDefaultPrim()


def turned_back(points):
    points = np.array(points, dtype=float).reshape(-1, 3)
    return np.stack([points[:, 0], points[:, 2], -points[:, 1]], 1) if up == "Z" else points


def world(prim, points, time):
    m = np.array(UsdGeom.Imageable(prim).ComputeLocalToWorldTransform(time))
    points = np.array(points, dtype=float).reshape(-1, 3)
    return turned_back(points @ m[:3, :3] + m[3, :3])


def close(got, want, name, time, tolerance=TOLERANCE):
    want = np.array(want, dtype=float).reshape(-1, 3)
    assert got.shape == want.shape, (name, time, got.shape, want.shape)
    error = np.abs(got - want).max() if len(want) else 0
    assert error <= tolerance, (name, time, error)
    return error


def skinned(prim, time):
    skel_root = UsdSkel.Root.Find(prim)
    cache = UsdSkel.Cache()
    assert cache.Populate(skel_root, Usd.PrimDefaultPredicate)
    for binding in cache.ComputeSkelBindings(skel_root, Usd.PrimDefaultPredicate):
        query = cache.GetSkelQuery(binding.GetSkeleton())
        for target in binding.GetSkinningTargets():
            if target.GetPrim() == prim:
                points = UsdGeom.Mesh(prim).GetPointsAttr().Get()
                assert target.ComputeSkinnedPoints(query.ComputeSkinningTransforms(time), points, time)
                return world(binding.GetSkeleton().GetPrim(), points, time)
    raise AssertionError(f"{prim} is not skinned")


def find(key, schema):
    """The prim of a placement's thing, wherever it stands below the placement."""
    placement, name = key.split("/")
    prims = [p for p in Usd.PrimRange(root.GetChild(placement)) if p.GetName() == name and p.IsA(schema)]
    assert len(prims) == 1, (key, prims)
    return prims[0]


def instances(prim, list_, time, key):
    instancer = UsdGeom.PointInstancer(prim)
    transforms = instancer.ComputeInstanceTransformsAtTime(
        time, time, UsdGeom.PointInstancer.ExcludeProtoXform, UsdGeom.PointInstancer.IgnoreMask)
    assert len(transforms) == len(list_), key
    mask = instancer.ComputeMaskAtTime(time) or [True] * len(list_)
    protos = [stage.GetPrimAtPath(p) for p in instancer.GetPrototypesRel().GetTargets()]
    which = instancer.GetProtoIndicesAttr().Get(time)
    for i, want in enumerate(list_):
        assert mask[i] == want["alive"], (key, time, i)
        points = np.array(UsdGeom.Mesh(protos[which[i]]).GetPointsAttr().Get(), dtype=float)
        m = np.array(transforms[i])
        got = world(prim, points @ m[:3, :3] + m[3, :3], time)
        reach = np.linalg.norm(points, axis=1).max()
        close(got, want["points"], key, time, TOLERANCE + HALF * reach)
        # The pivot does not suffer from the turn.
        close(got[:1], want["points"][:1], key, time)


count = 0
for number, frame in wanted["frames"].items():
    time = Usd.TimeCode(int(number))
    for key, want in frame["meshes"].items():
        prim = find(key, UsdGeom.Mesh)
        if prim.HasAPI(UsdSkel.BindingAPI):
            got = skinned(prim, time)
        else:
            got = world(prim, UsdGeom.Mesh(prim).GetPointsAttr().Get(time), time)
        close(got, want, key, time)
        count += 1
    for key, want in frame["instancers"].items():
        instances(find(key, UsdGeom.PointInstancer), want, time, key)
        count += 1
    for key, want in frame["points"].items():
        prim = find(key, UsdGeom.Points)
        close(world(prim, UsdGeom.Points(prim).GetPointsAttr().Get(time), time), want["positions"], key, time)
        widths = np.array(UsdGeom.Points(prim).GetWidthsAttr().Get(time), dtype=np.float32)
        assert (widths == np.array(want["widths"], dtype=np.float32)).all(), (key, time)
        count += 1
    for key, want in frame["curves"].items():
        prim = find(key, UsdGeom.BasisCurves)
        close(world(prim, UsdGeom.BasisCurves(prim).GetPointsAttr().Get(time), time), want, key, time)
        count += 1
assert count == 10 * len(wanted["frames"]), count
