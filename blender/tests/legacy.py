# SPDX-License-Identifier: GPL-3.0-or-later
"""Installs the zip for Blender before 4.2 as its preferences do, and removes it: legacy.py ZIP MANIFEST.

Runs in a Blender that has neither extensions nor USD, such as Debian's 3.4, with BLENDER_USER_SCRIPTS set to an empty folder: the
add-on registers, the menu has its entry, and the import is refused with its reason. Prints one line of JSON.
"""

import json
import os
import pathlib
import sys

import addon_utils
import bpy

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
import script

MODULE = "osier_import"


def classes() -> list[str]:
    """Registered classes of the add-on."""
    return [name for name in dir(bpy.types) if name.startswith(("OSIER_", "IMPORT_SCENE_OT_osier"))]


def menu() -> list[str]:
    """Functions of the add-on that draw in File > Import."""
    drawn = bpy.types.TOPBAR_MT_file_import._dyn_ui_initialize()
    return [f.__name__ for f in drawn if f.__module__.startswith(MODULE)]


def refusal(manifest: str) -> str:
    """What Blender says when a bake is to be imported."""
    try:
        bpy.ops.import_scene.osier(filepath=manifest)
    except RuntimeError as error:
        return str(error)
    return ""


def main() -> None:
    target, manifest = sys.argv[-2:]
    assert not classes()
    assert bpy.ops.preferences.addon_install(filepath=target) == {"FINISHED"}
    assert bpy.ops.preferences.addon_enable(module=MODULE) == {"FINISHED"}
    folder = os.path.dirname(sys.modules[MODULE].__file__)
    told = next(m.bl_info for m in addon_utils.modules(refresh=True) if m.__name__ == MODULE)
    report = {
        "version": list(bpy.app.version),
        "usd": bool(bpy.app.build_options.usd),
        "name": told["name"],
        "files": sorted(name for name in os.listdir(folder) if not name.startswith("__pycache__")),
        "classes": classes(),
        "menu": menu(),
        "refusal": refusal(manifest),
    }
    assert bpy.ops.preferences.addon_disable(module=MODULE) == {"FINISHED"}
    report["disabled"] = [*classes(), *menu()]
    try:
        bpy.ops.preferences.addon_remove(module=MODULE)
    except RuntimeError as error:
        # Blender 3.4 redraws the area of the preferences after it has removed the files, and without a window there is none.
        assert "tag_redraw" in str(error), error
    report["left"] = os.path.exists(folder)
    print(json.dumps(report))


script.run(main)
