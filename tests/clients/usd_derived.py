"""What follows from the points must agree with them: usd_derived.py FILE...

`extent` equals ComputeExtent at every sample time, velocities equal central differences within 5 percent, quaternions
have unit length, start with w >= 0 and never flip, ids count from 0, subsets are partitions at every sample time.
"""
import sys

import numpy as np
from pxr import Usd, UsdGeom, Vt

seen = set()


def times_of(prim):
    out = {None}
    for a in prim.GetAttributes():
        out.update(a.GetTimeSamples())
    return [Usd.TimeCode.Default() if t is None else Usd.TimeCode(t) for t in sorted(out, key=lambda t: -1 if t is None else t)]


def extents(prim):
    boundable = UsdGeom.Boundable(prim)
    for time in times_of(prim):
        got = boundable.GetExtentAttr().Get(time)
        want = UsdGeom.Boundable.ComputeExtentFromPlugins(boundable, time)
        assert got is not None and len(got) == 2, (prim, time)
        points = prim.GetAttribute("points")
        if points and not points.Get(time):
            assert np.array(got).any() == False, (prim, time)
            continue
        assert np.abs(np.array(got) - np.array(want)).max() <= 1e-6 * max(1, np.abs(np.array(want)).max()), (prim.GetPath(), time, got, want)
        seen.add("extent " + prim.GetTypeName())


def velocities(prim, name, fps):
    v = prim.GetAttribute("velocities")
    if not v or not v.GetTimeSamples():
        return
    p = prim.GetAttribute(name)
    hidden = prim.GetAttribute("invisibleIds")
    times = p.GetTimeSamples()
    assert v.GetTimeSamples() == times, prim.GetPath()
    for before, time, after in zip(times, times[1:], times[2:]):
        arrays = [np.array(p.Get(t), dtype=float).reshape(-1, 3) for t in (before, time, after)]
        got = np.array(v.Get(time), dtype=float).reshape(-1, 3)
        assert len(got) == len(arrays[1]), (prim.GetPath(), time)
        if len({len(a) for a in arrays}) > 1:
            continue
        want = (arrays[2] - arrays[0]) * fps / (after - before)
        alive = np.ones(len(got), bool)
        for t in (before, time, after):
            if hidden:
                alive[list(hidden.Get(t) or [])] = False
            if prim.IsA(UsdGeom.Points):
                alive &= np.array(prim.GetAttribute("widths").Get(t)) > 0
        size = max(np.abs(want).max(), 1e-3)
        if prim.GetAttribute("faceVertexCounts") and len(prim.GetAttribute("faceVertexCounts").GetTimeSamples()) > 0:
            continue
        assert np.abs(got - want)[alive].max(initial=0) <= 0.05 * size, (prim.GetPath(), time, got, want)
        seen.add("velocities " + prim.GetTypeName())


def quaternions(prim, name):
    a = prim.GetAttribute(name)
    if not a:
        return
    before = None
    for t in a.GetTimeSamples() or [Usd.TimeCode.Default()]:
        q = np.array([[*v.GetImaginary(), v.GetReal()] for v in a.Get(t)], dtype=float)
        half = a.GetTypeName() == "quath[]"
        assert np.abs(np.linalg.norm(q, axis=1) - 1).max() < (1e-3 if half else 1e-6), (prim.GetPath(), t)
        if before is None:
            assert (q[:, 3] >= 0).all()
        else:
            assert ((q * before).sum(1) >= 0).all(), (prim.GetPath(), t)
        before = q
        seen.add("quaternions " + name)


def subsets(prim):
    mesh = UsdGeom.Mesh(prim)
    parts = UsdGeom.Subset.GetAllGeomSubsets(mesh)
    if not parts:
        return
    assert UsdGeom.Subset.GetFamilyType(mesh, "materialBind") == "partition"
    for time in times_of(prim):
        faces = sorted(i for s in parts for i in s.GetIndicesAttr().Get(time) or [])
        assert faces == list(range(len(mesh.GetFaceVertexCountsAttr().Get(time) or []))), (prim.GetPath(), time)
    seen.add("subsets")


for path in sys.argv[1:]:
    stage = Usd.Stage.Open(path)
    fps = stage.GetTimeCodesPerSecond()
    for prim in stage.TraverseAll():
        if prim.IsA(UsdGeom.PointBased) or prim.IsA(UsdGeom.PointInstancer):
            extents(prim)
            velocities(prim, "positions" if prim.IsA(UsdGeom.PointInstancer) else "points", fps)
        if prim.IsA(UsdGeom.Mesh):
            subsets(prim)
        for name in ("orientations", "rotations", "primvars:orient"):
            quaternions(prim, name)
        ids = prim.GetAttribute("ids")
        if ids:
            assert list(ids.Get()) == list(range(len(ids.Get()))), prim.GetPath()
            seen.add("ids")
print(sorted(seen))
for what in ("extent Mesh", "extent Points", "extent BasisCurves", "extent PointInstancer", "velocities Mesh",
             "velocities Points", "velocities PointInstancer", "quaternions orientations", "quaternions rotations",
             "quaternions primvars:orient", "subsets", "ids"):
    assert what in seen, (what, sorted(seen))
