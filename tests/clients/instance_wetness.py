"""Prints the wetness of a stage's instances at its last frame, as JSON."""
import json
import sys

from pxr import Usd, UsdGeom

stage = Usd.Stage.Open(sys.argv[1])
values = []
for prim in stage.Traverse():
    if prim.IsA(UsdGeom.PointInstancer):
        wetness = UsdGeom.PrimvarsAPI(prim).GetPrimvar("wetness")
        if wetness:
            assert wetness.GetInterpolation() == "vertex", wetness.GetInterpolation()
            values += list(wetness.Get(stage.GetEndTimeCode()))
print(json.dumps(values))
