# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks what imports change and keep: behaviour.py MANIFEST OTHER FOLDER.

Runs under bpy 4.2 or newer. MANIFEST is a bake with points or leaves, OTHER another bake; FOLDER is empty and gets copies. Prints
`{"failed": [...]}` with the checks that do not hold.
"""

import functools
import json
import os
import pathlib
import shutil
import subprocess
import sys
import traceback
import types

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

import bpy
import osier_import
import script

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


def appended_bakes_leave_the_range_when_reloaded(manifest: str, _other: str, folder: pathlib.Path) -> None:
    fresh()
    path, data = changed_copy(manifest, folder / "appended")
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = data["time"]["written"]
    load(str(path), into="APPEND")
    before = scene_settings()
    data["time"]["written"] = [data["time"]["written"][0], data["time"]["written"][1] - 1]
    path.write_text(json.dumps({**data, "bake_hash": "1" * 64}))
    assert bpy.ops.osier.reload() == {"FINISHED"}
    assert scene_settings() == before, (scene_settings(), before)


def this_scene_takes_the_settings(manifest: str, _other: str, _folder: pathlib.Path) -> None:
    fresh()
    scene = bpy.context.scene
    load(manifest, into="THIS")
    time = json.loads(pathlib.Path(manifest).read_text())["time"]
    assert bpy.context.scene == scene and "Cube" in scene.objects
    assert (scene.render.fps, [scene.frame_start, scene.frame_end]) == (time["fps"][0], time["written"])
    assert scene.camera.get("osier_id") and scene.world.get("osier_id")


def land_lights_from_below_in_eevee(manifest: str, other: str, _folder: pathlib.Path) -> None:
    def outputs() -> dict[str, object]:
        found = [n for n in bpy.context.scene.world.node_tree.nodes if n.bl_idname == "ShaderNodeOutputWorld"]
        return {n.target: n.inputs["Surface"].links[0].from_node for n in found}

    # The leaf stands alone: what is below it is the lower half of its sky.
    fresh()
    load(manifest, into="THIS")
    assert list(outputs()) == ["ALL"], outputs()
    fresh()
    load(other, into="THIS")
    shown = outputs()
    assert set(shown) == {"ALL", "EEVEE"} and shown["ALL"].name == "osier light", shown
    mix = shown["EEVEE"]
    assert mix.inputs[1].links[0].from_node == shown["ALL"]
    land = mix.inputs[2].links[0].from_node.inputs["Color"].default_value
    horizon = json.loads(pathlib.Path(other).read_text())["view"]["sky"]["stops"][0][1]
    # Grass and soil reflect 5 to 20 % of the light.
    assert all(0.0 < at < 0.4 * sky for at, sky in zip(land, horizon)), (list(land), horizon)


def new_scenes_have_shadows_and_rays_in_eevee(manifest: str, _other: str, _folder: pathlib.Path) -> None:
    fresh()
    load(manifest)
    eevee = bpy.context.scene.eevee
    off = [name for name in ("use_raytracing", "use_shadows", "use_fast_gi") if not getattr(eevee, name, True)]
    assert not off, off


def refusals_change_nothing(manifest: str, _other: str, folder: pathlib.Path) -> None:
    fresh()
    before = counts(), scene_settings()
    copied = folder / "broken"
    shutil.copytree(os.path.dirname(manifest), copied)
    assert "not complete" in refused(bpy.ops.import_scene.osier, filepath=str(copied / "nowhere.json"))
    (copied / "text.json").write_text("{")
    assert "JSON" in refused(bpy.ops.import_scene.osier, filepath=str(copied / "text.json"))
    data = json.loads(pathlib.Path(manifest).read_text())
    (copied / "newer.json").write_text(json.dumps({**data, "schema": 99}))
    assert "Update the extension" in refused(bpy.ops.import_scene.osier, filepath=str(copied / "newer.json"))
    (copied / "none.json").write_text(json.dumps({**data, "schema": None}))
    assert "damaged" in refused(bpy.ops.import_scene.osier, filepath=str(copied / "none.json"))
    (copied / "deep.json").write_text("[" * 100000)
    assert "JSON" in refused(bpy.ops.import_scene.osier, filepath=str(copied / "deep.json"))
    for file, said in (("../normal.exr", "outside its folder"), ("maps/none.exr", "are missing")):
        wet = [{**m, "maps": {"normal": file}} for m in data["materials"]]
        (copied / "map.json").write_text(json.dumps({**data, "materials": wet}))
        assert said in refused(bpy.ops.import_scene.osier, filepath=str(copied / "map.json"))
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
    entries = {material["name"]: material for material in data["materials"]}
    assert any(entries[name]["class"] == "leaf" for name in made), made
    for name, nodes in made.items():
        assert ("osier own color" in nodes) == entries[name]["params"]["vertex_colors"], name


def leaves_without_maps_of_water_are_told(manifest: str, other: str, folder: pathlib.Path) -> None:
    path, data = changed_copy(manifest, folder / "dry")

    def is_told(file: str) -> bool:
        return any("the leaves are dry" in note for note in osier_import.manifest.read(file).notes)

    assert not is_told(str(path)) and not is_told(other)
    for material in data["materials"]:
        material["maps"] = {}
    path.write_text(json.dumps(data))
    assert is_told(str(path))


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


def all_that_shows_a_bake_reloads(manifest: str, _other: str, folder: pathlib.Path) -> None:
    fresh()
    path, data = changed_copy(manifest, folder / "twice")
    # Two imports of one bake, and a copy that the user has made, with a material of its own.
    load(str(path))
    load(str(path))
    scene = bpy.context.scene
    source = next(o for o in bpy.data.objects if o.get("osier_id", "").endswith("/drops"))
    copy, own = source.copy(), bpy.data.materials.new("own")
    copy.data = source.data.copy()
    copy.data.materials[0] = own
    copy.location.x += 1
    scene.collection.objects.link(copy)
    bake_differently(path, data, f'over "drops" {{{TRIANGLE}}}')
    assert bpy.ops.osier.reload() == {"FINISHED"}
    drops = [o for o in bpy.data.objects if o.get("osier_id", "").endswith("/drops")]
    assert len(drops) == 3
    for item in drops:
        layer = next(s for s in bpy.data.scenes if item.name in s.objects).view_layers[0]
        layer.update()
        shown = item.evaluated_get(layer.depsgraph).data
        assert (len(item.data.vertices), len(shown.vertices)) == (3, 3), (item.name, len(item.data.vertices), len(shown.vertices))
    assert copy.data.materials[0] == own and own.name not in source.data.materials and copy.location.x != source.location.x


def pictures_of_changed_materials_are_read_again(_manifest: str, other: str, folder: pathlib.Path) -> None:
    fresh()
    path, data = changed_copy(other, folder / "pictures")
    load(str(path))
    nodes = next(m.node_tree.nodes for m in bpy.data.materials if "osier_id" in m and "osier color" in m.node_tree.nodes)
    nodes["osier surface"].inputs["IOR"].default_value = 1.75
    image = nodes["osier color"].image
    assert min(image.size) > 2 and image.pixels[0] >= 0
    small = bpy.data.images.new("small", 2, 2)
    small.filepath_raw, small.file_format = str(folder / "small.png"), "PNG"
    small.save()
    replace(pathlib.Path(image.filepath), (folder / "small.png").read_bytes())
    path.write_text(json.dumps({**data, "bake_hash": "1" * 64}))
    assert bpy.ops.osier.reload() == {"FINISHED"}
    assert nodes["osier color"].image == image and tuple(image.size) == (2, 2), tuple(image.size)


def changed_materials_show_the_frames_of_the_bake(manifest: str, _other: str, folder: pathlib.Path) -> None:
    fresh()
    path, data = changed_copy(manifest, folder / "frames")
    load(str(path))
    nodes = next(m.node_tree.nodes for m in bpy.data.materials if "osier_id" in m and "osier wetness" in m.node_tree.nodes)
    nodes["osier surface"].inputs["IOR"].default_value = 1.75
    wetness = nodes["osier wetness"]

    def shown() -> tuple:
        user = wetness.image_user
        return (user.frame_start, user.frame_duration, user.frame_offset, pathlib.Path(bpy.path.abspath(wetness.image.filepath)).name)

    first, last = data["time"]["written"]
    assert shown()[:3] == (first, last - first + 1, first - 1)
    # The clip begins three frames later, then one frame earlier; the last time the user has set a frame.
    for number, begins in enumerate((first + 3, first + 2)):
        if number == 1:
            wetness.image_user.frame_start, own = 7, shown()[3]
        for entry in (e for e in data["files"] if "items" in e):
            entry["frames"] = [begins, last]
            entry["items"] = [{**entry["items"][0], "frame": frame} for frame in range(begins, last + 1)]
        data["time"]["written"] = [begins, last]
        path.write_text(json.dumps({**data, "bake_hash": str(number) * 64}))
        assert bpy.ops.osier.reload() == {"FINISHED"}
        if number == 0:
            assert shown() == (begins, last - begins + 1, begins - 1, f"wetness.{begins:04}.exr"), shown()
    assert shown() == (7, last - first - 2, first + 2, own), shown()
    assert nodes["osier surface"].inputs["IOR"].default_value == 1.75


def copies_of_materials_are_the_users(manifest: str, _other: str, folder: pathlib.Path) -> None:
    # Blender lists materials by name: the copy comes before its original, or after it.
    for number, name in enumerate(("A copy", "zz copy")):
        fresh()
        path, data = changed_copy(manifest, folder / f"copied_{number}")
        load(str(path))
        meshes = [o.data for o in bpy.data.objects if o.get("osier_id", "").endswith("/bark")]
        original, rest = meshes[0].materials[0], {m.name: [s.name for s in m.materials] for m in meshes[1:]}
        copy = original.copy()
        copy.name, shown = name, original.name
        copy.node_tree.nodes["osier surface"].inputs["IOR"].default_value = 1.75
        meshes[0].materials[0] = copy
        owner = next(o for o in bpy.data.objects if o.data == meshes[0])
        for turn in "12":
            path.write_text(json.dumps({**data, "bake_hash": turn * 64}))
            assert bpy.ops.osier.reload() == {"FINISHED"}
            assert owner.data.materials[0] == copy and copy.node_tree.nodes["osier surface"].inputs["IOR"].default_value == 1.75
            others = [o.data for o in bpy.data.objects if o.get("osier_id", "").endswith("/bark") and o != owner]
            assert [[s.name for s in m.materials] for m in others] == list(rest.values()), others
            made = bpy.data.materials.get(shown)
            assert made is None or made.node_tree.nodes["osier surface"].inputs["IOR"].default_value < 1.75


def projects_reload_where_they_are(manifest: str, _other: str, folder: pathlib.Path) -> None:
    # A file that is saved after the import, or before it and reloaded; a moved project, and a copy beside its original.
    for number, (saved_first, move) in enumerate([(False, os.rename), (True, os.rename), (False, shutil.copytree)]):
        fresh()
        project, moved = folder / f"project_{number}", folder / f"moved_{number}"
        path, data = changed_copy(manifest, project / "bake")
        save = functools.partial(bpy.ops.wm.save_as_mainfile, filepath=str(project / "saved.blend"))
        if saved_first:
            save()
        load(str(path))
        if saved_first:
            path.write_text(json.dumps({**data, "bake_hash": "2" * 64}))
            assert bpy.ops.osier.reload() == {"FINISHED"}
        save()
        move(project, moved)
        bpy.ops.wm.open_mainfile(filepath=str(moved / "saved.blend"))
        files = [bpy.path.abspath(f.filepath) for f in (*bpy.data.images, *bpy.data.cache_files) if f.filepath]
        assert len(files) > 3 and all(f.startswith(str(moved)) and os.path.isfile(f) for f in files), files
        (moved / "bake" / "manifest.json").write_text(json.dumps({**data, "bake_hash": "1" * 64}))
        assert bpy.ops.osier.reload() == {"FINISHED"}
        marks = [(c["osier_hash"], c["osier_folder"]) for c in bpy.data.collections if "osier_hash" in c]
        assert marks == [("1" * 64, str(moved / "bake"))], (number, marks)


def another_name_of_the_scene_keeps_the_objects(manifest: str, _other: str, folder: pathlib.Path) -> None:
    fresh()
    path, data = changed_copy(manifest, folder / "name")
    load(str(path), into="THIS")
    root = next(o for o in bpy.context.scene.objects if o.get("osier_id", "").endswith(":leaf"))
    root.location.x += 5
    before = counts(), root.as_pointer(), root.location.x
    path.write_text(json.dumps({**data, "bake_hash": "1" * 64, "scene": {**data["scene"], "name": "renamed"}}))
    assert bpy.ops.osier.reload() == {"FINISHED"}
    assert (counts(), bpy.data.objects[root.name].as_pointer(), root.location.x) == before, (counts(), before)
    assert root["osier_id"] == "renamed:leaf"


def modifiers_and_collections_of_the_artist_stay(manifest: str, _other: str, folder: pathlib.Path) -> None:
    fresh()
    path, data = changed_copy(manifest, folder / "artist")
    load(str(path))
    scene = bpy.data.scenes[data["scene"]["name"]]
    bark = next(o for o in scene.objects if o.get("osier_id", "").endswith("/bark"))
    modifier = bark.modifiers.new("artist", "DISPLACE")
    modifier.strength = 0.125
    # A collection of the artist's with an object of the bake and one of the artist's own, and one inside the bake's.
    beside, inside, own = bpy.data.collections.new("beside"), bpy.data.collections.new("inside"), bpy.data.objects.new("own", None)
    scene.collection.children.link(beside)
    next(c for c in bpy.data.collections if "osier_hash" in c).children.link(inside)
    for collection in (beside, inside):
        collection.objects.link(bark)
        collection.objects.link(own)
    names, before = [m.name for m in bark.modifiers], counts()
    for number in "12":
        path.write_text(json.dumps({**data, "bake_hash": number * 64}))
        assert bpy.ops.osier.reload() == {"FINISHED"}
        assert [m.name for m in bark.modifiers] == names and bark.modifiers["artist"].strength == 0.125, list(bark.modifiers)
        for collection in (beside, inside):
            assert {bark.name, own.name} == set(collection.objects.keys()), collection.objects.keys()
        assert beside.name in scene.collection.children and inside in list(scene.collection.children_recursive)
        assert counts() == before, (counts(), before)


def new_materials_reload(manifest: str, _other: str, folder: pathlib.Path) -> None:
    fresh()
    path, data = changed_copy(manifest, folder / "new_material")
    load(str(path))
    # One that the user has removed is built again, as is one that the earlier bake did not have.
    name = next(m.name for m in bpy.data.materials if "osier_id" in m)
    bpy.data.materials.remove(bpy.data.materials[name])
    path.write_text(json.dumps({**data, "bake_hash": "1" * 64}))
    assert bpy.ops.osier.reload() == {"FINISHED"}
    assert "osier surface" in bpy.data.materials[name].node_tree.nodes and bpy.data.materials[name].users > 0


def materials_without_users_are_left_out(manifest: str, _other: str, folder: pathlib.Path) -> None:
    fresh()
    path, data = changed_copy(manifest, folder / "unused_material")
    unused = {**data["materials"][0], "name": "unused"}
    path.write_text(json.dumps({**data, "materials": [*data["materials"], unused]}))
    load(str(path))
    assert "unused" not in bpy.data.materials
    before = sorted(m.name for m in bpy.data.materials)
    assert all(m.users for m in bpy.data.materials if "osier_id" in m), before
    more = [*data["materials"], unused, {**unused, "name": "also_unused"}]
    path.write_text(json.dumps({**data, "bake_hash": "1" * 64, "materials": more}))
    assert bpy.ops.osier.reload() == {"FINISHED"}
    assert sorted(m.name for m in bpy.data.materials) == before, before


def linked_bakes_stay(manifest: str, _other: str, folder: pathlib.Path) -> None:
    fresh()
    path, data = changed_copy(manifest, folder / "linked")
    load(str(path))
    name = next(c.name for c in bpy.data.collections if "osier_hash" in c)
    library = str(folder / "library.blend")
    bpy.ops.wm.save_as_mainfile(filepath=library)
    fresh()
    with bpy.data.libraries.load(library, link=True) as (_, wanted):
        wanted.collections = [name]
    linked = wanted.collections[0]
    bpy.context.scene.collection.children.link(linked)
    path.write_text(json.dumps({**data, "bake_hash": "1" * 64}))
    assert bpy.ops.osier.reload() == {"FINISHED"}
    # A change of linked data would be lost with the next opening.
    assert linked["osier_hash"] == data["bake_hash"]


def names_of_materials_that_are_too_long_are_told(manifest: str, _other: str, folder: pathlib.Path) -> None:
    fresh()
    path, data = changed_copy(manifest, folder / "long_material")
    name = 300 * "m"
    sheet = f'def Mesh "sheet" {{{TRIANGLE}rel material:binding = </rain/{name}>\n}}\ndef Material "{name}" {{ }}\n'
    bake_differently(path, {**data, "materials": [*data["materials"], {**data["materials"][0], "name": name}]}, sheet)
    before = counts()
    assert "characters of a name" in refused(bpy.ops.import_scene.osier, filepath=str(path))
    assert counts() == before


def bakes_import_without_cycles(_manifest: str, other: str, _folder: pathlib.Path) -> None:
    fresh()
    engine = bpy.context.scene.render.engine
    bpy.ops.preferences.addon_disable(module="cycles")
    try:
        load(other, into="THIS")
    finally:
        bpy.ops.preferences.addon_enable(module="cycles")
    assert bpy.context.scene.render.engine == engine != "CYCLES"
    assert [c for c in bpy.data.collections if "osier_hash" in c]


def deleted_objects_stay_deleted(manifest: str, _other: str, folder: pathlib.Path) -> None:
    fresh()
    path, data = changed_copy(manifest, folder / "deleted")
    load(str(path))

    def parts() -> set[str]:
        return {o["osier_id"].split(":", 1)[1] for o in bpy.data.objects if "osier_id" in o}

    before = parts()
    away = {part for part in before if part in ("sun", "rain/drops") or part.startswith("level")}
    assert len(away) > 4, before
    bpy.data.batch_remove([o for o in bpy.data.objects if o.get("osier_id", ":").split(":", 1)[1] in away])
    for number in "12":
        path.write_text(json.dumps({**data, "bake_hash": number * 64}))
        assert bpy.ops.osier.reload() == {"FINISHED"}
        # A plant of which nothing is left comes back.
        assert parts() == before - {"sun", "rain/drops"}, before - parts()


def dropped_manifests_show_their_options(manifest: str, _other: str, _folder: pathlib.Path) -> None:
    fresh()
    shown = []
    manager = types.SimpleNamespace(invoke_props_dialog=lambda _: shown.append("options"), fileselect_add=lambda _: shown.append("files"))

    class Invoked(osier_import.ops.OSIER_OT_import):
        """The import as a drop and the menu start it, with a window manager that has no window."""

        bl_idname = "import_scene.osier_invoked"

        def execute(self, _context: bpy.types.Context) -> set[str]:
            self.invoke(types.SimpleNamespace(window_manager=manager), None)
            return {"FINISHED"}

    bpy.utils.register_class(Invoked)
    bpy.ops.import_scene.osier_invoked(filepath=manifest)
    bpy.ops.import_scene.osier_invoked()
    bpy.utils.unregister_class(Invoked)
    assert shown == ["options", "files"], shown


STUDIO = """ocio_profile_version: 2
roles: {default: linear, scene_linear: linear, data: raw, default_byte: srgb_texture, color_picking: srgb_texture}
displays: {monitor: [!<View> {name: plain, colorspace: srgb_texture}]}
colorspaces:
  - !<ColorSpace> {name: linear}
  - !<ColorSpace> {name: raw, isdata: true}
  - !<ColorSpace> {name: srgb_texture, to_scene_reference: !<ExponentWithLinearTransform> {gamma: 2.4, offset: 0.055}}
"""
"""A configuration of OpenColorIO with other names than Blender's."""

IN_A_STUDIO = """
import os, sys
sys.path.insert(0, sys.argv[1])
import bpy, osier_import
osier_import.register()
bpy.ops.import_scene.osier(filepath=sys.argv[2])
spaces = {i.colorspace_settings.name for i in bpy.data.images if i.filepath}
assert spaces == {"raw", "srgb_texture"}, spaces
assert bpy.data.scenes["wet_leaf"].view_settings.view_transform == "plain"
sys.stdout.flush()
os._exit(0)
"""


def other_configurations_of_colors_import(manifest: str, _other: str, folder: pathlib.Path) -> None:
    config = folder / "studio.ocio"
    config.write_text(STUDIO)
    command = [sys.executable, "-c", IN_A_STUDIO, str(pathlib.Path(osier_import.__file__).parents[1]), manifest]
    done = subprocess.run(command, env={**os.environ, "OCIO": str(config)}, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr


def main() -> None:
    manifest, other, folder = sys.argv[1:]
    failed = []
    osier_import.register()
    for check in (
        appending_keeps_the_scene,
        appended_bakes_leave_the_range_when_reloaded,
        this_scene_takes_the_settings,
        land_lights_from_below_in_eevee,
        new_scenes_have_shadows_and_rays_in_eevee,
        refusals_change_nothing,
        older_manifests_open,
        colors_at_points_are_seen,
        leaves_without_maps_of_water_are_told,
        frames_between_need_not_be_baked,
        reloads_take_the_frame_rate_unless_it_was_set,
        names_that_are_too_long_are_told,
        a_failing_reload_changes_nothing,
        all_that_shows_a_bake_reloads,
        pictures_of_changed_materials_are_read_again,
        changed_materials_show_the_frames_of_the_bake,
        copies_of_materials_are_the_users,
        projects_reload_where_they_are,
        another_name_of_the_scene_keeps_the_objects,
        modifiers_and_collections_of_the_artist_stay,
        new_materials_reload,
        materials_without_users_are_left_out,
        linked_bakes_stay,
        names_of_materials_that_are_too_long_are_told,
        files_open_again,
        undo_removes_and_redo_restores,
        bakes_import_without_cycles,
        deleted_objects_stay_deleted,
        dropped_manifests_show_their_options,
        other_configurations_of_colors_import,
    ):
        try:
            check(manifest, other, pathlib.Path(folder))
        except Exception:
            failed.append(f"{check.__name__}: {traceback.format_exc(limit=-2)}")
    print(json.dumps({"failed": failed}))


script.run(main)
