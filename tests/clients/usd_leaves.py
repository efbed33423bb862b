"""Prints the leaves of a stage's instancers at its first and its last frame, as JSON: one object per instancer and frame."""
import json
import sys

from pxr import Usd, UsdGeom, UsdShade

stage = Usd.Stage.Open(sys.argv[1])
told = []
for prim in stage.Traverse():
    if not prim.IsA(UsdGeom.PointInstancer):
        continue
    instancer = UsdGeom.PointInstancer(prim)
    materials = []
    for path in instancer.GetPrototypesRel().GetTargets():
        bound = UsdShade.MaterialBindingAPI(stage.GetPrimAtPath(path)).ComputeBoundMaterial()[0]
        materials.append(bound.GetPrim().GetName() if bound else "")
    for time in (stage.GetStartTimeCode(), stage.GetEndTimeCode()):
        protos = instancer.GetProtoIndicesAttr().Get(time)
        hidden = set(instancer.GetInvisibleIdsAttr().Get(time) or [])
        shown = [i for i in range(len(protos)) if i not in hidden]
        values = {}
        for primvar in UsdGeom.PrimvarsAPI(prim).GetPrimvars():
            assert primvar.GetInterpolation() == "vertex", primvar.GetName()
            all_values = primvar.Get(time)
            assert len(all_values) == len(protos), (primvar.GetName(), len(all_values), len(protos))
            rows = [all_values[i] for i in shown]
            values[primvar.GetPrimvarName()] = [list(v) if hasattr(v, "__len__") else v for v in rows]
        told.append({
            "name": prim.GetName(),
            "materials": [materials[protos[i]] for i in shown],
            "values": values,
        })
print(json.dumps(told))
