# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks what imports change and keep: behaviour.py MANIFEST OTHER FOLDER.

Runs under bpy 4.2 or newer. MANIFEST is a bake with points or leaves, OTHER another bake; FOLDER is empty and gets copies. Prints
`{"failed": [...]}` with the checks that do not hold.
"""

import json
import os
import pathlib
import shutil
import sys
import traceback

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

import bpy
import osier_import

KINDS = ("objects", "meshes", "materials", "collections", "worlds", "cameras", "lights", "actions", "cache_files", "scenes", "images")


def counts() -> dict[str, int]:
    """How much data of each kind there is."""
    return {kind: len(getattr(bpy.data, kind)) for kind in KINDS}


def fresh() -> None:
    """The factory scene."""
    bpy.ops.wm.read_factory_settings()


def load(path: str, **options: str) -> None:
    """Imports a bake that must be good."""
    assert bpy.ops.import_scene.osier(filepath=path, **options) == {"FINISHED"}


def refused(operator, **options: str) -> str:
    """The message of an operator that must fail."""
    try:
        operator(**options)
    except RuntimeError as error:
        return str(error)
    raise AssertionError("no error")


def replace(path: pathlib.Path, content: bytes) -> None:
    """Puts a new file in place of one that Blender may have mapped, as osier does."""
    other = path.with_suffix(".new")
    other.write_bytes(content)
    os.replace(other, path)


def scene_settings() -> tuple:
    """Settings of the scene that an import may set."""
    s = bpy.context.scene
    return (s.render.fps, s.frame_start, s.frame_end, s.render.engine, s.view_settings.view_transform, s.camera, s.world)


def appending_keeps_the_scene(manifest: str, other: str, _folder: pathlib.Path) -> None:
    fresh()
    before, objects = scene_settings(), len(bpy.context.scene.objects)
    load(manifest, into="APPEND")
    load(other, into="APPEND")
    assert scene_settings() == before
    assert len(bpy.context.scene.objects) > objects + 4


def this_scene_takes_the_settings(manifest: str, _other: str, _folder: pathlib.Path) -> None:
    fresh()
    scene = bpy.context.scene
    load(manifest, into="THIS")
    time = json.loads(pathlib.Path(manifest).read_text())["time"]
    assert bpy.context.scene == scene and "Cube" in scene.objects
    assert (scene.render.fps, [scene.frame_start, scene.frame_end]) == (time["fps"][0], time["written"])
    assert scene.camera.get("osier_id") and scene.world.get("osier_id")


def refusals_change_nothing(manifest: str, _other: str, folder: pathlib.Path) -> None:
    fresh()
    before = counts(), scene_settings()
    copied = folder / "broken"
    shutil.copytree(os.path.dirname(manifest), copied)
    assert "not complete" in refused(bpy.ops.import_scene.osier, filepath=str(copied / "none.json"))
    (copied / "text.json").write_text("{")
    assert "JSON" in refused(bpy.ops.import_scene.osier, filepath=str(copied / "text.json"))
    data = json.loads(pathlib.Path(manifest).read_text())
    (copied / "newer.json").write_text(json.dumps({**data, "schema": 99}))
    assert "Update the extension" in refused(bpy.ops.import_scene.osier, filepath=str(copied / "newer.json"))
    next(iter((copied / "usd").glob("*.usdc"))).write_bytes(b"damaged")
    for into in ("NEW", "THIS"):
        refused(bpy.ops.import_scene.osier, filepath=str(copied / "manifest.json"), into=into)
    assert (counts(), scene_settings()) == before, (counts(), before)


def older_manifests_open(manifest: str, _other: str, folder: pathlib.Path) -> None:
    fresh()
    copied = folder / "older"
    shutil.copytree(os.path.dirname(manifest), copied)
    data = json.loads((copied / "manifest.json").read_text())
    for key in ("stage", "places", "view"):
        data.pop(key, None)
    for key in ("written", "loop"):
        data["time"].pop(key, None)
    for key in ("wet_albedo", "wet_roughness"):
        data["units"].pop(key, None)
    for asset in data["assets"]:
        asset.pop("plant", None), asset.pop("points_material", None)
    (copied / "manifest.json").write_text(json.dumps(data))
    load(str(copied / "manifest.json"))
    assert any(o.type == "MESH" for o in bpy.context.scene.objects)


def changed_copy(manifest: str, folder: pathlib.Path) -> tuple[pathlib.Path, dict]:
    """A copy of a bake in a folder that does not exist yet: the path of its manifest and what it says."""
    shutil.copytree(os.path.dirname(manifest), folder)
    path = folder / "manifest.json"
    return path, json.loads(path.read_text())


def colors_at_points_are_seen(manifest: str, _other: str, folder: pathlib.Path) -> None:
    fresh()
    path, data = changed_copy(manifest, folder / "colored")
    for material in data["materials"]:
        material["params"]["vertex_colors"] = material["class"] == "leaf"
    path.write_text(json.dumps(data))
    load(str(path))
    made = {m["osier_id"].split(":", 1)[1]: m.node_tree.nodes for m in bpy.data.materials if "osier_id" in m}
    for material in data["materials"]:
        reads = "osier own color" in made[material["name"]]
        assert reads == material["params"]["vertex_colors"], material["name"]


def frames_between_need_not_be_baked(manifest: str, _other: str, folder: pathlib.Path) -> None:
    fresh()
    path, data = changed_copy(manifest, folder / "stepped")
    data["time"]["step"] = 4
    for entry in (e for e in data["files"] if "items" in e):
        first = entry["frames"][0]
        for item in entry["items"]:
            if (item["frame"] - first) % 4:
                (path.parent / entry["path"].replace("####", f"{item['frame']:04}")).unlink()
        entry["items"] = [i for i in entry["items"] if (i["frame"] - first) % 4 == 0]
    path.write_text(json.dumps(data))
    load(str(path), into="THIS")
    scene = bpy.context.scene
    assert [scene.frame_start, scene.frame_end, scene.frame_step] == [*data["time"]["written"], 4]


def reloads_take_the_frame_rate_unless_it_was_set(manifest: str, _other: str, folder: pathlib.Path) -> None:
    fresh()
    path, data = changed_copy(manifest, folder / "rate")
    load(str(path), into="THIS")
    render = bpy.context.scene.render
    # The first number of a rate is at most 32767 in Blender; the rate of 12 was set by hand and stays.
    rates = [(None, [30, 1], 30), (None, [60000, 1001], 60000 / 1001), (12, [25, 1], 12 / 1.001)]
    for number, (own, baked, wanted) in enumerate(rates):
        render.fps = own or render.fps
        data["time"]["fps"], data["bake_hash"] = baked, str(number) * 64
        path.write_text(json.dumps(data))
        assert bpy.ops.osier.reload() == {"FINISHED"}
        assert abs(render.fps / render.fps_base / wanted - 1) < 1e-6, (render.fps, render.fps_base)


def names_that_are_too_long_are_told(manifest: str, _other: str, folder: pathlib.Path) -> None:
    fresh()
    path, data = changed_copy(manifest, folder / "long")
    plant = next(a for a in data["assets"] if a["kind"] == "plant")
    path.write_text(json.dumps(data).replace(json.dumps(plant["prim"]), json.dumps("/" + 256 * "a")))
    assert "characters of a name" in refused(bpy.ops.import_scene.osier, filepath=str(path))


def a_failing_reload_changes_nothing(manifest: str, _other: str, folder: pathlib.Path) -> None:
    fresh()
    copied = folder / "reload"
    shutil.copytree(os.path.dirname(manifest), copied)
    path = copied / "manifest.json"
    load(str(path))
    before = counts()
    data = json.loads(path.read_text())
    path.write_text(json.dumps({**data, "bake_hash": "0" * 64}))
    stage = next(iter((copied / "usd").glob("*.usdc")))
    kept = stage.read_bytes()
    replace(stage, b"damaged")
    refused(bpy.ops.osier.reload)
    assert counts() == before, (counts(), before)
    users = [m for o in bpy.data.objects for m in o.modifiers if m.type == "MESH_SEQUENCE_CACHE"]
    assert all(m.cache_file for m in users)
    # Mended, it reloads: nothing is doubled.
    replace(stage, kept)
    bpy.ops.osier.reload()
    assert counts() == before, (counts(), before)


def files_open_again(manifest: str, _other: str, folder: pathlib.Path) -> None:
    fresh()
    load(manifest)
    names, frame = sorted(o.name for o in bpy.context.scene.objects), bpy.context.scene.frame_end
    target = str(folder / "saved.blend")
    bpy.ops.wm.save_as_mainfile(filepath=target)
    bpy.ops.wm.open_mainfile(filepath=target)
    assert sorted(o.name for o in bpy.context.scene.objects) == names
    bpy.context.scene.frame_set(frame)
    assert all(os.path.exists(bpy.path.abspath(f.filepath)) for f in bpy.data.cache_files)
    sequences = [i for i in bpy.data.images if i.source == "SEQUENCE"]
    assert all(os.path.exists(bpy.path.abspath(i.filepath)) for i in sequences)


def undo_removes_and_redo_restores(manifest: str, _other: str, _folder: pathlib.Path) -> None:
    fresh()
    bpy.ops.ed.undo_push(message="before")
    before = counts()
    load(manifest, into="THIS")
    bpy.ops.ed.undo_push(message="import")
    after = counts()
    bpy.ops.ed.undo()
    assert counts()["objects"] == before["objects"], counts()
    bpy.ops.ed.redo()
    assert counts()["objects"] == after["objects"], counts()


def bake_differently(path: pathlib.Path, data: dict, content: str) -> None:
    """Adds content in the notation of USD to the rain, and marks the bake as another one."""
    stage = path.parent / "usd" / "assets.usda"
    head, rain, tail = stage.read_text().partition('def Xform "rain" (')
    before, _, after = tail.partition("{")
    stage.write_text(head + rain + before + "{" + content + after)
    path.write_text(json.dumps({**data, "bake_hash": "1" * 64}))


TRIANGLE = """
int[] faceVertexCounts = [3]
int[] faceVertexIndices = [0, 1, 2]
point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
"""


def new_materials_reload(manifest: str, _other: str, folder: pathlib.Path) -> None:
    fresh()
    path, data = changed_copy(manifest, folder / "new_material")
    load(str(path))
    added = {**data["materials"][0], "name": "added"}
    path.write_text(json.dumps({**data, "bake_hash": "1" * 64, "materials": [*data["materials"], added]}))
    assert bpy.ops.osier.reload() == {"FINISHED"}
    assert "osier surface" in bpy.data.materials["added"].node_tree.nodes


def names_of_materials_that_are_too_long_are_told(manifest: str, _other: str, folder: pathlib.Path) -> None:
    fresh()
    path, data = changed_copy(manifest, folder / "long_material")
    name = 300 * "m"
    sheet = f'def Mesh "sheet" {{{TRIANGLE}rel material:binding = </rain/{name}>\n}}\ndef Material "{name}" {{ }}\n'
    bake_differently(path, {**data, "materials": [*data["materials"], {**data["materials"][0], "name": name}]}, sheet)
    before = counts()
    assert "characters of a name" in refused(bpy.ops.import_scene.osier, filepath=str(path))
    assert counts() == before


def main() -> None:
    manifest, other, folder = sys.argv[1:]
    failed = []
    osier_import.register()
    for check in (
        appending_keeps_the_scene,
        this_scene_takes_the_settings,
        refusals_change_nothing,
        older_manifests_open,
        colors_at_points_are_seen,
        frames_between_need_not_be_baked,
        reloads_take_the_frame_rate_unless_it_was_set,
        names_that_are_too_long_are_told,
        a_failing_reload_changes_nothing,
        new_materials_reload,
        names_of_materials_that_are_too_long_are_told,
        files_open_again,
        undo_removes_and_redo_restores,
    ):
        try:
            check(manifest, other, pathlib.Path(folder))
        except Exception:
            failed.append(f"{check.__name__}: {traceback.format_exc(limit=-2)}")
    print(json.dumps({"failed": failed}))
    sys.stdout.flush()
    os._exit(0)


main()
