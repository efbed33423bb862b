# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads the materials of curves after an import: curves.py MANIFEST.

Runs under bpy 4.2 or newer. Prints the names of the materials of each object of curves by the last name of its path, as JSON.
"""

import json
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

import bpy
import osier_import
import script
from osier_import.materials import base_name


def main() -> None:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    osier_import.register()
    assert bpy.ops.import_scene.osier(filepath=sys.argv[1]) == {"FINISHED"}
    curves = [o for o in bpy.data.objects if o.type in ("CURVES", "CURVE")]
    told = sorted({(o["osier_id"].rsplit("/", 1)[-1], *(base_name(m.name) for m in o.data.materials)) for o in curves})
    print(json.dumps(told))


script.run(main)
