# SPDX-License-Identifier: GPL-3.0-or-later
"""Uses the panel from a folder of modules, without its wheel, in any Blender: folder.py ZIP FOLDER, with OSIER_PROGRAM set.

Blender before 4.2 has no extensions, and Debian's 3.4 no USD: the panel registers and bakes, and says why it cannot import.
Prints one line of JSON.
"""

import json
import os
import pathlib
import sys
import time
import zipfile

import bpy

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
import script
from recorder import draw_all


def main() -> None:
    target, folder = sys.argv[-2:]
    with zipfile.ZipFile(target) as packed:
        packed.extractall(os.path.join(folder, "osier_panel"), [n for n in packed.namelist() if n.endswith(".py")])
    sys.path.insert(0, folder)
    import osier_panel
    from osier_panel import panel, properties, session

    osier_panel.register()
    scene = bpy.context.scene
    scene.osier.preset = "grass"
    session.default_folder = lambda: os.path.join(folder, "bakes")

    def work() -> None:
        end = time.monotonic() + 120
        while session.tick() is not None:
            assert time.monotonic() < end
            time.sleep(0.01)

    session.session.wake()
    work()
    drawn = draw_all(panel)
    properties.group(scene).wind__speed = -1
    low = properties.group(scene).wind__speed
    properties.group(scene).ground__show = False
    assert bpy.ops.osier.bake() == {"FINISHED"}
    work()
    draw_all(panel)
    report = {
        "version": list(bpy.app.version),
        "usd": bool(bpy.app.build_options.usd),
        "keys": len(session.session.fields),
        "drawn": len(drawn),
        "low": low,
        "baked": os.path.isfile(os.path.join(session.bake_folder(scene), "manifest.json")),
        "shown": any("osier_hash" in c for c in bpy.data.collections),
        "errors": session.session.errors,
    }
    osier_panel.unregister()
    report["left"] = [name for name in dir(bpy.types) if name.startswith(("OSIER_", "IMPORT_SCENE_OT_osier"))]
    print(json.dumps(report))


script.run(main)
