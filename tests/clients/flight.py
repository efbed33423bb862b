"""Catkins of a bake: flight.py usd STAGE OUT.json FRAME... writes what usd-core reads; flight.py bpy STAGE IN.json holds
Blender to it.

usd: prototypes with levels of detail hold something at each, lines behind catkins end where those are and nowhere leap; at
each frame the number of slots, the numbers of those alive, their positions and velocities, and what the twin says
they are doing. bpy: as many instances are alive, they are at the same places, and hairs are seen: something of each
prototype has an extent of centimetres.
"""
import json
import os
import sys

import numpy as np


def by_usd(path, out, frames):
    from pxr import Usd, UsdGeom

    stage = Usd.Stage.Open(path)
    found = [UsdGeom.PointInstancer(p) for p in stage.Traverse() if p.IsA(UsdGeom.PointInstancer)]
    flying = [p for p in found if p.GetPath().name == "catkins"]
    assert len(flying) == 1, found
    flying = flying[0]
    beside = Usd.Stage.Open(os.path.join(os.path.dirname(path), "usd", "catkins.points.usdc"))
    twins = [p for p in beside.Traverse() if p.IsA(UsdGeom.Points) and p.HasAttribute("primvars:state")]
    assert len(twins) == 1, twins
    levels = variants(stage, flying)
    lines = [UsdGeom.BasisCurves(p) for p in stage.Traverse() if p.GetName() == "trails"]
    ids = np.array(flying.GetIdsAttr().Get())
    assert (ids == np.arange(len(ids))).all()
    told = {"count": len(ids), "frames": {}}
    for frame in frames:
        hidden = set(flying.GetInvisibleIdsAttr().Get(frame) or [])
        alive = [i for i in range(len(ids)) if i not in hidden]
        positions = np.array(flying.GetPositionsAttr().Get(frame), dtype=float)
        velocities = np.array(flying.GetVelocitiesAttr().Get(frame), dtype=float)
        state = np.array(twins[0].GetAttribute("primvars:state").Get(frame))
        points = np.array(UsdGeom.Points(twins[0]).GetPointsAttr().Get(frame), dtype=float)
        assert np.abs(points - positions).max() < 1e-6
        # Pending is 0 and exited 5; all others are seen.
        assert [i for i in range(len(ids)) if state[i] not in (0, 5)] == alive, frame
        if lines:
            counts = np.array(lines[0].GetCurveVertexCountsAttr().Get())
            drawn = np.array(lines[0].GetPointsAttr().Get(frame), dtype=float).reshape(len(ids), counts[0], 3)
            assert (counts == counts[0]).all() and np.abs(drawn[alive, -1] - positions[alive]).max(initial=0) < 1e-6, frame
            steps = np.linalg.norm(np.diff(drawn, axis=1), axis=2)
            # What left and came back, or fell asleep, draws no line across the box.
            assert steps.max() < 0.5, (frame, steps.max())
            assert frame == frames[0] or (steps.sum(axis=1) > 0.05).sum() > 10, frame
        told["frames"][frame] = {
            "alive": alive, "positions": positions[alive].tolist(), "velocities": velocities[alive].tolist(),
            "states": np.bincount(state, minlength=6).tolist(),
        }
    json.dump(told, open(out, "w"))
    print("levels", levels, "lines", len(lines))
    return told


def variants(stage, flying):
    """Names of the levels that every prototype has; each holds points, fewer the coarser it is."""
    from pxr import UsdGeom

    names = []
    for path in flying.GetPrototypesRel().GetTargets():
        prim = stage.GetPrimAtPath(path)
        chosen = prim.GetVariantSet("LOD")
        names = chosen.GetVariantNames() if prim.HasVariantSets() else []
        own, sizes = chosen.GetVariantSelection(), []
        for name in names:
            assert chosen.SetVariantSelection(name)
            below = [UsdGeom.PointBased(p) for p in stage.Traverse() if p.GetPath().HasPrefix(path) and p.IsA(UsdGeom.PointBased)]
            sizes.append(sum(len(p.GetPointsAttr().Get()) for p in below))
        if names:
            chosen.SetVariantSelection(own)
            # lod0 is hairs as curves: less than the tubes of lod1.
            rest = [s for n, s in zip(names, sizes) if n != "lod0"]
            assert min(sizes) > 0 and rest == sorted(rest, reverse=True), (names, sizes)
    return names


def by_blender(stage, wanted):
    import bpy

    bpy.ops.wm.read_factory_settings(use_empty=True)
    assert bpy.ops.wm.usd_import(filepath=stage) == {"FINISHED"}
    wanted = json.load(open(wanted))
    worst = 0.0
    for frame, want in wanted["frames"].items():
        bpy.context.scene.frame_set(int(frame))
        depsgraph = bpy.context.evaluated_depsgraph_get()
        places, kinds = [], {}
        for i in depsgraph.object_instances:
            if not i.is_instance or i.object.type not in ("MESH", "CURVES", "CURVE"):
                continue
            m = np.array(i.matrix_world)
            kinds.setdefault(i.object.type, []).append(m[:3, 3])
            size = max(i.object.dimensions)
            assert size > 0.0005, (i.object.name, size)
        # A prototype of stalk and hairs comes as one instance of each.
        counts = {k: len(v) for k, v in kinds.items()}
        assert (counts or not want["alive"]) and all(n == len(want["alive"]) for n in counts.values()), (frame, counts, len(want["alive"]))
        for places in kinds.values():
            got = np.array(places)
            got = np.stack([got[:, 0], got[:, 2], -got[:, 1]], 1)
            from_wanted = np.array(want["positions"])
            # Nearest to nearest: instances of one prototype come together.
            for k in range(0, len(from_wanted), 200):
                part = from_wanted[k : k + 200]
                away = np.linalg.norm(part[:, None] - got[None], axis=2)
                worst = max(worst, away.min(axis=1).max())
        assert worst < 1e-3, (frame, worst)
        print("frame", frame, counts, worst)
    return len(wanted["frames"])


mode, stage = sys.argv[1:3]
if mode == "usd":
    told = by_usd(stage, sys.argv[3], [int(f) for f in sys.argv[4:]])
    print(json.dumps({f: v["states"] for f, v in told["frames"].items()}))
else:
    print(by_blender(stage, sys.argv[3]), "frames")
