# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads colour and occlusion of leaves after an import: leaves.py MANIFEST FOLDER.

Runs under bpy 4.2 or newer. Prints for each instancer the number of its leaves, the means of their colours and occlusion, and the mean
of a picture in which leaves emit their occlusion and all else is black, as JSON.
"""

import json
import os
import pathlib
import shutil
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

import bpy
import osier_import
import script


def means(data: bpy.types.PointCloud) -> dict:
    """Means of the values of a cloud of leaves."""
    count = len(data.points)
    colors, shades = [0.0] * (4 * count), [0.0] * count
    data.attributes["leaf_color"].data.foreach_get("color", colors)
    data.attributes["canopy_occlusion"].data.foreach_get("value", shades)
    return {"count": count, "color": [sum(colors[k::4]) / count for k in range(4)], "occlusion": sum(shades) / count}


def emit_occlusion(material: bpy.types.Material) -> bool:
    """Replaces what a material shows by the occlusion that it reads, black without; whether it reads one."""
    tree = material.node_tree
    output = next(n for n in tree.nodes if n.type == "OUTPUT_MATERIAL")
    emission = tree.nodes.new("ShaderNodeEmission")
    emission.inputs["Color"].default_value = (0.0, 0.0, 0.0, 1.0)
    read = tree.nodes.get("osier canopy")
    if read:
        tree.links.new(read.outputs["Fac"], emission.inputs["Color"])
    tree.links.new(emission.outputs[0], output.inputs["Surface"])
    return read is not None


def instances() -> int:
    """How many instances the scene shows."""
    return sum(1 for item in bpy.context.evaluated_depsgraph_get().object_instances if item.is_instance)


def open_again(path: str) -> None:
    """Saves the file and opens it."""
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)


def check_files(path: str) -> None:
    """Saved files keep their leaves, before and after a reload."""
    shown = instances()
    open_again(path)
    assert instances() == shown > 0, (instances(), shown)
    next(c for c in bpy.data.collections if "osier_hash" in c)["osier_hash"] = "0" * 64
    assert bpy.ops.osier.reload() == {"FINISHED"}
    open_again(path)
    assert instances() == shown, (instances(), shown)


def check_copies(manifest: str, folder: str) -> None:
    """Copies that a bake has more than before have leaves: a second one, which is an object, and many, which are points."""
    copied = os.path.join(folder, "copies")
    shutil.copytree(os.path.dirname(manifest), copied)
    path = pathlib.Path(copied, "manifest.json")
    data = json.loads(path.read_text())
    name, places = next((name, places) for name, places in data["places"].items() if places)
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    assert bpy.ops.import_scene.osier(filepath=str(path)) == {"FINISHED"}
    shown = instances()
    for number, count in enumerate((2, 12, 1)):
        data["places"][name], data["bake_hash"] = places[:1] * count, str(number) * 64
        path.write_text(json.dumps(data))
        assert bpy.ops.osier.reload() == {"FINISHED"}
        # Those of a mesh of points are instances themselves, with their bark.
        assert instances() >= count * shown > 0, (count, instances(), shown)


def check_own_data(manifest: str, folder: str) -> None:
    """A copy that the user has given data and a material of its own keeps them; the other copies keep theirs."""
    copied = os.path.join(folder, "own")
    shutil.copytree(os.path.dirname(manifest), copied)
    path = pathlib.Path(copied, "manifest.json")
    data = json.loads(path.read_text())
    name, places = next((name, places) for name, places in data["places"].items() if places)
    data["places"][name] = places[:1] * 3
    path.write_text(json.dumps(data))
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    assert bpy.ops.import_scene.osier(filepath=str(path)) == {"FINISHED"}
    barks = sorted((o for o in bpy.data.objects if o.get("osier_id", "").endswith("/bark")), key=lambda o: o["osier_id"])
    assert len(barks) == 3
    before = barks[0].data.materials[0]
    barks[1].data = barks[1].data.copy()
    barks[1].data.materials[0] = bpy.data.materials.new("own")
    for turn in "12":
        path.write_text(json.dumps({**data, "bake_hash": turn * 64}))
        assert bpy.ops.osier.reload() == {"FINISHED"}
        worn = [o.data.materials[0] for o in barks]
        assert worn == [before, bpy.data.materials["own"], before], worn
        assert barks[0].data == barks[2].data != barks[1].data


def main() -> None:
    manifest, folder = sys.argv[1:]
    bpy.ops.wm.read_factory_settings()
    osier_import.register()
    check_copies(manifest, folder)
    check_own_data(manifest, folder)
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    assert bpy.ops.import_scene.osier(filepath=manifest) == {"FINISHED"}
    check_files(os.path.join(folder, "leaves.blend"))
    scene = bpy.context.scene
    clouds = {o["osier_id"].rsplit("/", 1)[-1]: o.data for o in bpy.data.objects if o.type == "POINTCLOUD"}
    told = {name: means(data) for name, data in clouds.items()}
    readers = sum([emit_occlusion(m) for m in bpy.data.materials if m.node_tree])
    scene.world.node_tree.nodes.clear()
    scene.view_settings.view_transform = "Raw"
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = 120, 120, 100
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.cycles.samples = 8
    scene.cycles.use_denoising = False
    scene.render.filepath = os.path.join(folder, "occlusion.exr")
    bpy.ops.render.render(write_still=True)
    values = list(bpy.data.images.load(scene.render.filepath).pixels)[::4]
    print(json.dumps({"leaves": told, "readers": readers, "brightest": max(values), "mean": sum(values) / len(values)}))


script.run(main)
