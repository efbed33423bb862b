# SPDX-License-Identifier: GPL-3.0-or-later
"""Installs the extension from its zip, imports bakes, removes it: install.py ZIP MANIFEST...

Runs under bpy 4.2 or newer with BLENDER_USER_RESOURCES set to an empty folder. Prints one line of JSON with what each import made.
"""

import json
import os
import sys

import bpy
import script


def classes() -> list[str]:
    """Registered classes of the extension."""
    return [name for name in dir(bpy.types) if name.startswith("OSIER_")]


def seen(manifest: str) -> dict:
    """Imports a bake and tells what the scene has."""
    assert bpy.ops.import_scene.osier(filepath=manifest) == {"FINISHED"}
    scene = bpy.context.scene
    users = [
        n.image_user
        for m in bpy.data.materials
        if m.node_tree
        for n in m.node_tree.nodes
        if n.name == "osier wetness"
    ]
    return {
        "objects": len(scene.objects),
        "fps": [scene.render.fps, scene.render.fps_base],
        "range": [scene.frame_start, scene.frame_end],
        "camera": scene.camera.name if scene.camera else None,
        "wetness": [[u.frame_start, u.frame_duration, u.frame_offset] for u in users],
    }


def main() -> None:
    bpy.ops.wm.read_factory_settings()
    assert not classes()
    bpy.ops.extensions.package_install_files(filepath=os.path.abspath(sys.argv[1]), repo="user_default", enable_on_install=True)
    assert "OSIER_OT_import" in classes() or hasattr(bpy.ops.import_scene, "osier")
    report = [seen(manifest) for manifest in sys.argv[2:]]
    module = "bl_ext.user_default.osier_import"
    folder = os.path.dirname(sys.modules[module].__file__)
    bpy.ops.preferences.addon_disable(module=module)
    assert not classes(), classes()
    repositories = bpy.context.preferences.extensions.repos
    index = next(i for i, r in enumerate(repositories) if r.module == "user_default")
    bpy.ops.extensions.package_uninstall(repo_index=index, pkg_id="osier_import")
    assert not os.path.exists(folder), folder
    print(json.dumps(report))


script.run(main)
