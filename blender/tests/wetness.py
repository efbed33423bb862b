# SPDX-License-Identifier: GPL-3.0-or-later
"""Measures the wetness of leaves over the clip in Cycles: wetness.py MANIFEST FOLDER FRAME...

Runs under bpy 4.2 or newer. The first and the last frame are rendered as the importer sets the scene up. Then leaves emit their wetness
in red and 1 in green, all else is black, and all frames are rendered. Prints as JSON `wetness`, the mean of the red channel of each
frame, and means of the untouched pictures at the first and the last frame: `leaf` over the pixels that show leaves, `wetted` over those
of leaves that got wetter between.
"""

import json
import os
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

import bpy
import osier_import
import script

RISE = 0.2
"""Rise of the wetness of a pixel from which it counts as wetted: a whole pixel's rises by 1, that at the rim of water by less."""


def emit_wetness(material: bpy.types.Material) -> None:
    """Replaces what a material shows by its wetness in red and 1 in green, black without any."""
    tree = material.node_tree
    output = next(n for n in tree.nodes if n.type == "OUTPUT_MATERIAL")
    emission = tree.nodes.new("ShaderNodeEmission")
    emission.inputs["Color"].default_value = (0.0, 0.0, 0.0, 1.0)
    wetness = tree.nodes.get("osier wetness")
    if wetness:
        color = tree.nodes.new("ShaderNodeCombineColor")
        color.inputs["Green"].default_value = 1.0
        tree.links.new(wetness.outputs["Color"], color.inputs["Red"])
        tree.links.new(color.outputs["Color"], emission.inputs["Color"])
    tree.links.new(emission.outputs[0], output.inputs["Surface"])


def channels(folder: str, kind: str, frame: int) -> list[list[float]]:
    """Red, green and blue of the pixels of a rendered frame."""
    scene = bpy.context.scene
    scene.frame_set(frame)
    scene.render.filepath = os.path.join(folder, f"{kind}_{frame}.exr")
    bpy.ops.render.render(write_still=True)
    values = list(bpy.data.images.load(scene.render.filepath).pixels)
    return [values[k::4] for k in range(3)]


def mean(values: list[float]) -> float:
    return sum(values) / len(values)


def main() -> None:
    manifest, folder, *numbers = sys.argv[1:]
    frames = [int(number) for number in numbers]
    bpy.ops.wm.read_factory_settings()
    osier_import.register()
    assert bpy.ops.import_scene.osier(filepath=manifest) == {"FINISHED"}
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = 240, 180, 100
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.cycles.samples = 16
    scene.cycles.use_denoising = False
    ends = [frames[0], frames[-1]]
    untouched = {frame: channels(folder, "untouched", frame) for frame in ends}
    for material in bpy.data.materials:
        if material.node_tree:
            emit_wetness(material)
    scene.world.node_tree.nodes.clear()
    scene.view_settings.view_transform = "Raw"
    emitted = {frame: channels(folder, "wetness", frame) for frame in frames}

    def brightness(frame: int, shown: list[int]) -> float:
        return mean([channel[i] for channel in untouched[frame] for i in shown])

    def of_leaves(frame: int) -> list[int]:
        return [i for i, green in enumerate(emitted[frame][1]) if green > 0.99]

    (before, *_), (after, *_) = (emitted[frame] for frame in ends)
    still = set(of_leaves(ends[0])) & set(of_leaves(ends[1]))
    wetted = [i for i in sorted(still) if after[i] > before[i] + RISE]
    report = {
        "wetness": [mean(emitted[frame][0]) for frame in frames],
        "leaf": [brightness(frame, of_leaves(frame)) for frame in ends],
        "wetted": [brightness(frame, wetted) for frame in ends],
    }
    print(json.dumps(report))


script.run(main)
