# SPDX-License-Identifier: GPL-3.0-or-later
"""Renders frames of a bake, as the importer sets the scene up: pictures.py MANIFEST FOLDER WIDTHxHEIGHT ENGINE FRAME...

ENGINE is CYCLES, which the importer chooses, or EEVEE. Runs under bpy 4.2 or newer. Nothing else is set by hand but the size of
the picture and the number of samples. Writes FOLDER/ENGINE_FRAME.png.
"""

import os
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

import bpy
import osier_import
import script


def main() -> None:
    manifest, folder, size, engine, *frames = sys.argv[1:]
    bpy.ops.wm.read_factory_settings()
    osier_import.register()
    assert bpy.ops.import_scene.osier(filepath=manifest) == {"FINISHED"}
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = map(int, size.split("x"))
    scene.render.resolution_percentage = 100
    scene.render.image_settings.file_format = "PNG"
    assert scene.render.engine == "CYCLES"
    # Blender 4.2 to 4.5 have an older EEVEE by the name that is the new one's since 5.0.
    if engine == "EEVEE":
        scene.render.engine = "BLENDER_EEVEE" if bpy.app.version >= (5, 0, 0) else "BLENDER_EEVEE_NEXT"
    scene.cycles.samples, scene.eevee.taa_render_samples = 24, 8
    for frame in map(int, frames):
        scene.frame_set(frame)
        scene.render.filepath = os.path.join(folder, f"{engine}_{frame}.png")
        bpy.ops.render.render(write_still=True)


script.run(main)
