# SPDX-License-Identifier: GPL-3.0-or-later
"""Imports the stage of a bake and sets up the scene that shows it."""

import contextlib
import os
from array import array
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

import bpy

from . import copies, materials, world
from .manifest import Asset, Bake, BakeError, Place
from .materials import base_name

KINDS_OF_DATA = (
    "scenes", "collections", "objects", "meshes", "pointclouds", "hair_curves", "curves", "volumes", "armatures", "actions",
    "materials", "images", "worlds", "cameras", "lights", "cache_files", "node_groups", "shape_keys",
)  # fmt: skip
"""Lists of `bpy.data` that an import adds to."""

LONGEST_NAME = 255 if bpy.app.version >= (5, 0, 0) else 63
"""Most characters of an object's name; Blender cuts off the rest."""

IMPORT_OPTIONS: dict[str, Any] = {
    "relative_path": False,
    "set_frame_range": False,
    "import_cameras": False,
    "import_lights": False,
    "import_usd_preview": False,
    "import_textures_mode": "IMPORT_NONE",
    "create_world_material": False,
    "mtl_name_collision_mode": "REFERENCE_EXISTING",
    "property_import_mode": "NONE",
    "attr_import_mode": "NONE",
}
"""Options of Blender's USD importer. Names differ between versions: each version gets those that it knows."""


@dataclass
class Report:
    """What an import has made, and what the user should know."""

    collection: bpy.types.Collection
    scene: bpy.types.Scene
    notes: list[str] = field(default_factory=list)


class Snapshot:
    """The data of a file at one time, to find what was added since."""

    def __init__(self) -> None:
        self._known = {kind: {d.as_pointer() for d in _list(kind)} for kind in KINDS_OF_DATA}

    def added(self, kinds: Iterable[str] = KINDS_OF_DATA) -> list[bpy.types.ID]:
        """Data that was added since, of some kinds."""
        return [d for kind in kinds for d in _list(kind) if d.as_pointer() not in self._known[kind]]

    def remove_added(self) -> None:
        """Removes all data that was added since."""
        # Keys of shapes are removed with what they belong to.
        bpy.data.batch_remove(self.added(k for k in KINDS_OF_DATA if k != "shape_keys"))


def _list(kind: str) -> Iterable[bpy.types.ID]:
    return getattr(bpy.data, kind, ())


def import_bake(context: bpy.types.Context, bake: Bake, into: str, look: str) -> Report:
    """Imports a checked bake into a new scene (NEW), this scene (THIS), or this scene without changing its settings (APPEND).

    Raises `BakeError`; then the file is as before.
    """
    before = Snapshot()
    scene = bpy.data.scenes.new(bake.scene) if into == "NEW" else context.scene
    settings = _settings(scene)
    try:
        if into != "APPEND":
            set_time(scene, bake)
        token = f"{bake.bake_hash[:16]}.{len(bpy.data.collections)}.{len(bpy.data.objects)}"
        collection = bpy.data.collections.new(bake.scene)
        scene.collection.children.link(collection)
        notes = list(bake.notes)
        built = materials.build_all(bake, token, {}, notes)
        objects = build(context, scene, bake, collection, built, token)
        materials.remove_unused(built.values())
        if bake.view:
            sky = world.build_world(bake)
            sky["osier_bake"] = token
            sky.use_fake_user = into == "APPEND"
            if into != "APPEND":
                scene.world = sky
                scene.camera = next(o for o in objects if o.type == "CAMERA")
    except BakeError:
        _restore(scene, settings, into)
        before.remove_added()
        raise
    except Exception as error:
        _restore(scene, settings, into)
        before.remove_added()
        cause = f"the import failed ({type(error).__name__}: {error})"
        raise BakeError(bake.path, cause, "Check the folder with osier info; nothing was changed") from error
    if into != "APPEND":
        notes += set_render(scene, bake)
        notes += world.set_look(scene, look)
        scene.frame_set(bake.first)
    else:
        notes += rates(scene, bake)
    mark(collection, bake, token, [o["osier_id"] for o in objects if "osier_id" in o])
    set_relative_paths(bake)
    if into != "APPEND":
        collection["osier_rate"] = rate(scene)
    if into == "NEW" and context.window:
        context.window.scene = scene
    return Report(collection, scene, notes)


def is_below(bake: Bake, path: str) -> bool:
    """Whether a file is in the folder of a bake."""
    folder, path = (os.path.realpath(p) for p in (bake.folder, bpy.path.abspath(path)))
    return path.startswith(folder + os.sep)


def set_relative_paths(bake: Bake) -> None:
    """Names the files of a bake relative to the saved file, if the preferences of Blender say so: the project can then be moved or copied."""
    if not bpy.data.filepath or not bpy.context.preferences.filepaths.use_relative_paths:
        return
    for item in (*bpy.data.images, *bpy.data.cache_files):
        if item.library or not item.filepath or item.filepath.startswith("//") or not is_below(bake, item.filepath):
            continue
        # Another path of a picture would read it again, and lose what was painted.
        name = "filepath_raw" if isinstance(item, bpy.types.Image) else "filepath"
        # On Windows there is no relative path to another drive.
        with contextlib.suppress(ValueError):
            setattr(item, name, bpy.path.relpath(item.filepath))


def mark(collection: bpy.types.Collection, bake: Bake, token: str, names: Iterable[str]) -> None:
    """Notes on a collection which bake it shows. `names`: identifiers of all objects of the bake."""
    collection["osier_folder"] = bake.folder
    collection["osier_manifest"] = bake.path
    collection["osier_hash"] = bake.bake_hash
    collection["osier_bake"] = token
    collection["osier_range"] = [bake.first, bake.last, bake.step]
    collection["osier_parts"] = "\n".join(name.split(":", 1)[1] for name in names)


def set_time(scene: bpy.types.Scene, bake: Bake) -> None:
    """Frame rate, range and step of the bake: frames that were not baked are not rendered."""
    set_rate(scene, bake)
    scene.frame_start, scene.frame_end, scene.frame_step = bake.first, bake.last, bake.step


def set_rate(scene: bpy.types.Scene, bake: Bake) -> None:
    """Frame rate of the bake as Blender's presets have it: 60 over 1.001, not 60000 over 1001, as the first is at most 32767."""
    frames, seconds = bake.fps
    scene.render.fps = max(round(frames / seconds), 1)
    scene.render.fps_base = scene.render.fps * seconds / frames


def rate(scene: bpy.types.Scene) -> list[float]:
    """Both numbers of a scene's frame rate, to find whether they were changed."""
    return [float(scene.render.fps), scene.render.fps_base]


def set_render(scene: bpy.types.Scene, bake: Bake) -> list[str]:
    """Settings of Cycles and EEVEE that suit leaves and drops, and the size of the picture. Returns notes for the user."""
    notes = []
    # Without rays EEVEE refracts the world alone, and drops on leaves are dark. Blender before 4.2 refracts what the screen shows. A scene
    # that is added by a script has no shadows in 4.5 and no fast approximation of indirect light, unlike one that a user adds.
    for name in ("use_raytracing", "use_shadows", "use_fast_gi", "use_ssr", "use_ssr_refraction"):
        materials.set_if_known(scene.eevee, name, True)
    try:
        scene.render.engine = "CYCLES"
    except TypeError:
        notes.append(f"the add-on Cycles is disabled: the scene keeps the render engine {scene.render.engine}, whose pictures differ")
    else:
        cycles = scene.cycles
        cycles.samples, cycles.use_denoising = 64, True
        cycles.caustics_reflective = cycles.caustics_refractive = False
        cycles.max_bounces = cycles.transmission_bounces = 12
        cycles.transparent_max_bounces = 16
    scene.render.use_motion_blur = False
    look = bake.view.get("look") or {}
    if look.get("shutter"):
        scene.render.motion_blur_shutter = look["shutter"]
    if bake.view:
        scene.render.resolution_x, scene.render.resolution_y = (int(v) for v in bake.view["camera"]["size"])
        scene.render.resolution_percentage = 100
    return notes


def rates(scene: bpy.types.Scene, bake: Bake) -> list[str]:
    """A note where a scene shows a bake at another speed."""
    mine, its = scene.render.fps / scene.render.fps_base, bake.fps[0] / bake.fps[1]
    return [] if abs(mine / its - 1.0) < 1e-6 else [f"scene has {mine:g} frames per second, the bake {its:g}"]


def _settings(scene: bpy.types.Scene) -> tuple[Any, ...]:
    render = scene.render
    return (render.fps, render.fps_base, scene.frame_start, scene.frame_end, scene.frame_step, scene.world, scene.camera)


def _restore(scene: bpy.types.Scene, settings: tuple[Any, ...], into: str) -> None:
    if into == "NEW":
        return
    render = scene.render
    render.fps, render.fps_base, scene.frame_start, scene.frame_end, scene.frame_step, scene.world, scene.camera = settings


def build(
    context: bpy.types.Context,
    scene: bpy.types.Scene,
    bake: Bake,
    collection: bpy.types.Collection,
    built: dict[str, bpy.types.Material],
    token: str,
) -> list[bpy.types.Object]:
    """Makes all objects of a bake below a collection of a scene, and returns them."""
    before = Snapshot()
    _import_stage(context, scene, bake, collection)
    by_name = {a.prim: a for a in bake.assets}
    roots = {}
    for item in [o for o in collection.objects if o.parent is None]:
        asset = by_name.get(base_name(item.name))
        if asset is not None:
            roots[asset.name] = item
    if bake.has_assets_stage:
        for asset in bake.assets:
            if asset.has_geometry and (asset.name not in roots or not _shows(roots[asset.name])):
                cause = f"Blender's USD importer could not read {asset.name}"
                step = "Check the folder with osier info and bake again"
                if len(asset.prim) > LONGEST_NAME:
                    raise _too_long(bake, asset.name)
                raise BakeError(bake.stage, cause, step)
    for item in before.added(["objects"]):
        if item.type == "EMPTY" and base_name(item.name) in ("mtl", "Prototypes") and not item.children:
            bpy.data.objects.remove(item)
    groups: dict[str, bpy.types.Collection] = {}
    for asset in bake.assets:
        root = roots.get(asset.name)
        if root is not None:
            _adopt(bake, asset, root, _group(bake, collection, groups, asset.group), collection)
            _set_leaf_values(bake, asset, root)
    _set_materials(bake, before.added(["objects"]), built)
    if bake.has_assets_stage:
        _place_all(bake, roots, collection, groups)
    if bake.view:
        for item, name in ((world.camera_object(bake), "camera"), (world.sun_object(bake), "sun")):
            item["osier_id"] = f"{bake.scene}:{name}"
            item["osier_view"] = world.values(item)
            collection.objects.link(item)
    objects = before.added(["objects"])
    for item in objects:
        item["osier_bake"] = token
        item["osier_base"] = [v for row in item.matrix_basis for v in row]
    for child in before.added(["collections"]):
        if base_name(child.name) == "prototypes" and "osier_id" not in child:
            bpy.data.collections.remove(child)
        else:
            child["osier_bake"] = token
    wanted = {m.as_pointer() for m in built.values()}
    bpy.data.batch_remove([m for m in before.added(["materials"]) if m.as_pointer() not in wanted])
    return objects


def _import_stage(
    context: bpy.types.Context, scene: bpy.types.Scene, bake: Bake, collection: bpy.types.Collection
) -> None:
    """Reads the USD into a collection."""
    if not bpy.app.build_options.usd:
        raise BakeError(bake.path, "this Blender was built without USD", "Use a Blender from blender.org")
    options = dict(IMPORT_OPTIONS)
    if not bake.has_assets_stage:
        options.update(import_cameras=True, import_lights=True)
    known = bpy.ops.wm.usd_import.get_rna_type().properties
    layer = scene.view_layers[0] if scene is not context.scene else context.view_layer
    active = layer.active_layer_collection
    layer.active_layer_collection = _layer_collection(layer.layer_collection, collection)
    try:
        with context.temp_override(scene=scene, view_layer=layer):
            done = bpy.ops.wm.usd_import(filepath=bake.stage, **{k: v for k, v in options.items() if k in known})
    except RuntimeError as error:
        raise BakeError(bake.stage, f"Blender's USD importer failed ({str(error).strip()})", "Bake again") from error
    finally:
        layer.active_layer_collection = active
    if done != {"FINISHED"}:
        raise BakeError(bake.stage, "Blender's USD importer failed", "Bake again")


def _layer_collection(root: bpy.types.LayerCollection, wanted: bpy.types.Collection) -> bpy.types.LayerCollection:
    for child in root.children:
        if child.collection == wanted:
            return child
        found = _layer_collection(child, wanted)
        if found.collection == wanted:
            return found
    return root


def _too_long(bake: Bake, name: str) -> BakeError:
    """The error about a name that this Blender cuts off."""
    cause = f"{name} is longer than the {LONGEST_NAME} characters of a name in this Blender"
    return BakeError(bake.stage, cause, "Bake again with a shorter name of the plant")


def _shows(root: bpy.types.Object) -> bool:
    return any(o.type != "EMPTY" for o in copies.hierarchy(root))


def _group(
    bake: Bake, parent: bpy.types.Collection, groups: dict[str, bpy.types.Collection], name: str
) -> bpy.types.Collection:
    """The collection of a kind of plant."""
    if name not in groups:
        groups[name] = bpy.data.collections.new(name)
        groups[name]["osier_id"] = f"{bake.scene}:{name}/"
        parent.children.link(groups[name])
    return groups[name]


def _adopt(
    bake: Bake, asset: Asset, root: bpy.types.Object, target: bpy.types.Collection, source: bpy.types.Collection
) -> None:
    """Names the objects of an asset and moves them into the collection of its kind."""
    # Parts get their names before the asset: a part may have that of the asset, which the asset would get with a number.
    for item, path in reversed(list(_paths(root, asset.name))):
        _name(item, bake, asset.name, path)
        if item.name in source.objects:
            source.objects.unlink(item)
        target.objects.link(item)
        for modifier in item.modifiers:
            prototypes = modifier.type == "NODES" and modifier.node_group and _instanced(modifier.node_group)
            if prototypes:
                _adopt_prototypes(bake, asset, path, prototypes)
                _hold(item, prototypes)
                modifier.node_group.name = f"{asset.name} {path.rsplit('/', 1)[-1]}"


def _set_leaf_values(bake: Bake, asset: Asset, root: bpy.types.Object) -> None:
    """Gives the points of leaves their colour and occlusion, which Blender's importer drops: materials read them from instances."""
    rows = bake.leaf_rows(asset)
    for item in copies.hierarchy(root):
        values = rows.get(item["osier_id"].rsplit("/", 1)[-1])
        points = item.data
        if values is None or item.type != "POINTCLOUD" or 4 * len(points.points) != len(values):
            continue
        if asset.leaves.color:
            colors = array("f", values)
            colors[3::4] = array("f", [1.0]) * len(points.points)
            points.attributes.new("leaf_color", "FLOAT_COLOR", "POINT").data.foreach_set("color", colors)
        if asset.leaves.occlusion:
            points.attributes.new("canopy_occlusion", "FLOAT", "POINT").data.foreach_set("value", values[3::4])


def _adopt_prototypes(bake: Bake, asset: Asset, path: str, prototypes: bpy.types.Collection) -> None:
    prototypes.name = f"{asset.name} prototypes"
    prototypes["osier_id"] = f"{bake.scene}:{path}/"
    for child in prototypes.children:
        part = base_name(child.name)
        child["osier_id"] = f"{bake.scene}:{path}/{part}/"
        for root in [o for o in child.objects if o.parent is None]:
            for item, below in _paths(root, f"{path}/{part}/{base_name(root.name)}"):
                _name(item, bake, asset.name, below)


def _hold(item: bpy.types.Object, prototypes: bpy.types.Collection) -> None:
    """Makes an object a user of what it instances: the node that Blender's importer has set is not counted as one, so that the collection
    would be left out of saved files, and all leaves with it.
    """
    item["osier_prototypes"] = prototypes


def _instanced(group: bpy.types.NodeTree) -> bpy.types.Collection | None:
    """The collection whose objects a node group of Blender's importer shows."""
    for node in group.nodes:
        if node.bl_idname == "GeometryNodeCollectionInfo":
            return node.inputs["Collection"].default_value
    return None


def _paths(item: bpy.types.Object, path: str) -> Iterator[tuple[bpy.types.Object, str]]:
    """An object and all below it with paths of names as in the USD file."""
    yield item, path
    for child in list(item.children):
        yield from _paths(child, f"{path}/{base_name(child.name)}")


def _name(item: bpy.types.Object, bake: Bake, asset: str, path: str) -> None:
    item["osier_id"] = f"{bake.scene}:{path}"
    part = path.rsplit("/", 1)[-1]
    name = asset if path == asset else f"{asset} {part}"
    item.name = name
    if item.data:
        item.data.name = name
    action = item.animation_data and item.animation_data.action
    if action:
        action.name = name


def _set_materials(bake: Bake, items: list[bpy.types.Object], built: dict[str, bpy.types.Material]) -> None:
    """Gives all slots the materials of this import, and points and curves without a slot those of the manifest: Blender's importer gives
    them none.
    """
    assets = {a.name: a for a in bake.assets}
    longest = max(built, key=len, default="")
    for item in items:
        if item.data is None or not hasattr(item.data, "materials"):
            continue
        slots = item.data.materials
        for i, material in enumerate(slots):
            wanted = built.get(base_name(material.name)) if material else None
            if wanted is not None and wanted != material:
                slots[i] = wanted
            if wanted is None and material and len(longest) > LONGEST_NAME:
                raise _too_long(bake, longest)
        if item.type in ("POINTCLOUD", "CURVES", "CURVE") and not slots and "osier_id" in item:
            path = item["osier_id"].split(":", 1)[1].split("/")
            asset = assets.get(path[0])
            name = asset and (asset.points_material if item.type == "POINTCLOUD" else asset.curve_materials.get(path[-1]))
            if built.get(name or ""):
                slots.append(built[name])


def _place_all(
    bake: Bake,
    roots: dict[str, bpy.types.Object],
    collection: bpy.types.Collection,
    groups: dict[str, bpy.types.Collection],
) -> None:
    """Puts every asset to its placements; assets without placements are removed."""
    group_of = {a.name: a.group for a in bake.assets}
    by_group: dict[str, list[Place]] = {}
    for place in bake.places:
        if place.asset in roots:
            by_group.setdefault(group_of[place.asset], []).append(place)
    caches: dict[Any, bpy.types.CacheFile] = {}
    for name, places in by_group.items():
        if copies.is_many(places):
            _place_points(bake, name, places, roots, groups[name], caches)
        else:
            _place_objects(bake, places, roots, groups[name], caches)
    placed = {p.asset for p in bake.places}
    unused = [o for name, root in roots.items() if name not in placed for o in copies.hierarchy(root)]
    if unused:
        bpy.data.batch_remove(unused)


def _tag(bake: Bake, items: list[bpy.types.Object], asset: str, tag: str) -> None:
    """Puts a placement or time into the identifiers of objects."""
    for item in items:
        rest = item["osier_id"][len(bake.scene) + 1 + len(asset) :]
        item["osier_id"] = f"{bake.scene}:{asset}{tag}{rest}"


def _place_objects(
    bake: Bake,
    places: list[Place],
    roots: dict[str, bpy.types.Object],
    target: bpy.types.Collection,
    caches: dict[Any, bpy.types.CacheFile],
) -> None:
    """The first placement of an asset takes the imported objects, the others copies that share their data."""
    for name in dict.fromkeys(p.asset for p in places):
        mine = [p for p in places if p.asset == name]
        sets = [copies.hierarchy(roots[name])]
        for i in range(1, len(mine)):
            copied = copies.duplicate(roots[name])
            _tag(bake, copied, name, f"#{i + 1}")
            for item in copied:
                target.objects.link(item)
            sets.append(copied)
        for items, place in zip(sets, mine, strict=True):
            items[0].matrix_basis = copies.blender_matrix(place) @ items[0].matrix_basis
            copies.shift(items, bake, place.offset, caches)


def _place_points(
    bake: Bake,
    name: str,
    places: list[Place],
    roots: dict[str, bpy.types.Object],
    target: bpy.types.Collection,
    caches: dict[Any, bpy.types.CacheFile],
) -> None:
    """One object with a point for each placement; one prototype for each asset and time of the clip."""
    order = {a.name: i for i, a in enumerate(bake.assets)}
    span = bake.span()
    keys = sorted({(order[p.asset], p.offset % span) for p in places})
    numbers = {key: i for i, key in enumerate(keys)}
    prototypes, used = [], set()
    sources = {order[p.asset]: p.asset for p in places}
    pending = []
    for i, (index, offset) in enumerate(keys):
        asset = sources[index]
        pending.append((i, asset, offset, copies.duplicate(roots[asset]) if asset in used else None))
        used.add(asset)
    for i, asset, offset, copied in pending:
        items = copied or copies.hierarchy(roots[asset])
        # Collection Info orders its children by name.
        prototype = bpy.data.collections.new(f"{i:04} {asset} +{offset:g}")
        prototype["osier_id"] = f"{bake.scene}:{name}/{asset}@{offset:g}/"
        for item in items:
            if item.name in target.objects:
                target.objects.unlink(item)
            prototype.objects.link(item)
        _tag(bake, items, asset, f"@{offset:g}")
        copies.shift(items, bake, offset, caches)
        prototypes.append(prototype)
    shown = copies.scatter(name, places, prototypes, [numbers[order[p.asset], p.offset % span] for p in places])
    shown["osier_id"] = f"{bake.scene}:{name}/copies"
    prototypes_of(shown)["osier_id"] = f"{bake.scene}:{name}/copied/"
    target.objects.link(shown)


def prototypes_of(shown: bpy.types.Object) -> bpy.types.Collection:
    """The collection of prototypes of an object of copies."""
    modifier = next(m for m in shown.modifiers if m.type == "NODES" and m.node_group.get("osier_id") == copies.GROUP)
    return modifier[copies.collection_input(modifier.node_group)]
