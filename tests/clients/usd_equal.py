"""Two stages are equal as text: usd_equal.py A B"""
import sys

from pxr import Sdf

a, b = (Sdf.Layer.FindOrOpen(p) for p in sys.argv[1:])
a, b = a.ExportToString().splitlines(), b.ExportToString().splitlines()
for n, (x, y) in enumerate(zip(a, b), 1):
    assert x == y, (n, x[:200], y[:200])
assert len(a) == len(b) > 100
