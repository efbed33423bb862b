"""Arrays read back by usd-core, bit for bit: usd_arrays.py FOLDER EXPECTED.json

EXPECTED: [{"file", "prim", "attr", "type", "times": [...], "at": {"default" or time: [numbers]}}]; floats are given as
their bits, quaternions as x, y, z, w.
"""
import json
import os
import sys

import numpy as np
from pxr import Gf, Sdf

layers = {}
for want in json.load(open(sys.argv[2])):
    layer = layers.setdefault(want["file"], Sdf.Layer.FindOrOpen(os.path.join(sys.argv[1], want["file"])))
    path = f"{want['prim']}.{want['attr']}"
    spec = layer.GetAttributeAtPath(path)
    assert spec, path
    assert str(spec.typeName) == want["type"], (path, spec.typeName)
    times = layer.ListTimeSamplesForPath(path)
    assert list(times) == want["times"], (path, times, want["times"])
    for time, numbers in want["at"].items():
        value = spec.default if time == "default" else layer.QueryTimeSample(path, float(time))
        assert value is not None, (path, time)
        if want["type"].startswith("quat"):
            value = [[*q.GetImaginary(), q.GetReal()] for q in value]
        kind = want["type"].rstrip("[]")
        if kind in ("int", "int64"):
            got = [int(x) for x in value]
        elif kind == "token":
            got = [str(x) for x in value]
        elif kind in ("quath", "half3"):
            got = np.array(value, dtype=np.float16).ravel().view(np.uint16).tolist()
        else:
            got = np.array(value, dtype=np.float32).ravel().view(np.uint32).tolist()
        assert got == numbers, (path, time, got, numbers)
