# SPDX-License-Identifier: GPL-3.0-or-later
"""Measures the wetness of leaves over the clip in Cycles: wetness.py MANIFEST FOLDER FRAME...

Runs under bpy 4.2 or newer. The bake is imported and nothing is set by hand, but that leaves emit their wetness and all else is
black, so that the mean of a picture is the wetness that is seen. Prints the means as JSON.
"""

import json
import os
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

import bpy
import osier_import
import script


def emit_wetness(material: bpy.types.Material) -> None:
    """Replaces what a material shows by its wetness, black without any."""
    tree = material.node_tree
    output = next(n for n in tree.nodes if n.type == "OUTPUT_MATERIAL")
    emission = tree.nodes.new("ShaderNodeEmission")
    emission.inputs["Color"].default_value = (0.0, 0.0, 0.0, 1.0)
    wetness = tree.nodes.get("osier wetness")
    if wetness:
        tree.links.new(wetness.outputs["Color"], emission.inputs["Color"])
    tree.links.new(emission.outputs[0], output.inputs["Surface"])


def mean(folder: str, frame: int) -> float:
    """Mean of the first channel of the rendered frame."""
    scene = bpy.context.scene
    scene.frame_set(frame)
    scene.render.filepath = os.path.join(folder, f"wetness_{frame}.exr")
    bpy.ops.render.render(write_still=True)
    picture = bpy.data.images.load(scene.render.filepath)
    values = list(picture.pixels)[::4]
    return sum(values) / len(values)


def main() -> None:
    manifest, folder, *frames = sys.argv[1:]
    bpy.ops.wm.read_factory_settings()
    osier_import.register()
    assert bpy.ops.import_scene.osier(filepath=manifest) == {"FINISHED"}
    scene = bpy.context.scene
    for material in bpy.data.materials:
        if material.node_tree:
            emit_wetness(material)
    scene.world.node_tree.nodes.clear()
    scene.view_settings.view_transform = "Raw"
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = 240, 180, 100
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.cycles.samples = 16
    scene.cycles.use_denoising = False
    means = [mean(folder, int(frame)) for frame in frames]
    print(json.dumps(means))


script.run(main)
