"""Layers that a user edits and saves in place keep all that was in them: usd_save.py FILE..."""
import sys

from pxr import Sdf

for path in sys.argv[1:]:
    layer = Sdf.Layer.FindOrOpen(path)
    before = layer.ExportToString()
    layer.comment = "edited"
    edited = layer.ExportToString()
    assert edited != before
    assert layer.Save(), path
    assert Sdf.Layer.OpenAsAnonymous(path).ExportToString() == edited, path
