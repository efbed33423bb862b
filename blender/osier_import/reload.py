# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads a changed bake again: objects stay and show new data; what the user has changed stays, too."""

import os
import re
from collections.abc import Iterable
from typing import Any

import bpy
from mathutils import Matrix

from . import copies, materials, stage, world
from .manifest import Bake, BakeError


def reload_bake(context: bpy.types.Context, collection: bpy.types.Collection, bake: Bake) -> list[str]:
    """Replaces what the objects of a bake show. Returns notes for the user.

    Raises `BakeError`; then the file is as before.
    """
    token = collection["osier_bake"]
    _rename_scene(bake, token)
    old, twins = _originals(collection, marked(bpy.data.objects, token))
    old_groups = {c["osier_id"]: c for c in reversed(marked(bpy.data.collections, token))}
    scenes = [s for s in bpy.data.scenes if collection in s.collection.children_recursive]
    scene = context.scene if context.scene in scenes or not scenes else scenes[0]
    released, others = _release_caches(bake, token)
    before = stage.Snapshot()
    temporary = bpy.data.collections.new("osier reload")
    scene.collection.children.link(temporary)
    try:
        # Names of the materials are those of this import; existing ones are rebuilt only after the stage was read.
        mine = materials.originals(marked(bpy.data.materials, token))
        placeholders = {e["name"]: mine.get(e["name"]) or bpy.data.materials.new(e["name"]) for e in bake.materials}
        objects = stage.build(context, scene, bake, temporary, placeholders, token)
    except Exception as error:
        before.remove_added()
        _restore_caches(released + others)
        if isinstance(error, BakeError):
            raise
        cause = f"the import failed ({type(error).__name__}: {error})"
        raise BakeError(bake.path, cause, "Bake again; the objects show the earlier bake") from error
    _restore_caches(others)
    kept: list[str] = []
    # Copies of materials belong to the user, who has put them into slots.
    for material in marked(bpy.data.materials, token):
        if material not in mine.values():
            for name in ("osier_bake", "osier_id", "osier_sig", "osier_name"):
                material.pop(name, None)
    for entry in bake.materials:
        material = placeholders[entry["name"]]
        if material.get("osier_bake") != token:
            material["osier_bake"] = token
            material["osier_sig"] = materials.signature(material.node_tree)
            material["osier_id"] = f"{bake.scene}:{entry['name']}"
    pictures = [i for i in bpy.data.images if i.users]
    materials.build_all(bake, token, placeholders, kept)
    bpy.data.batch_remove([i for i in pictures if i.users == 0])
    _reload_pictures(bake)
    notes = [f"kept the changed material {name}" for name in kept]
    notes += _take_twins(twins, old, objects)
    names = [o["osier_id"] for o in objects if "osier_id" in o]
    unwanted = _deleted(collection, bake, old, objects)
    if unwanted:
        notes.append(f"{len(unwanted)} objects that were deleted stay deleted: import the bake again to see them")
    _replace(collection, temporary, old, old_groups, objects, before.added(["collections"]), unwanted)
    # Earlier materials may be without users because the user wants it so.
    materials.remove_unused(m for m in placeholders.values() if m not in mine.values())
    notes += _set_view(bake, token, collection, scenes)
    for same in [c for c in marked(bpy.data.collections, token, "osier_hash") if c == collection or c["osier_manifest"] == bake.path]:
        stage.mark(same, bake, token, names)
    stage.set_relative_paths(bake)
    return notes


def marked(items: Iterable[bpy.types.ID], token: str, name: str = "osier_id") -> list[bpy.types.ID]:
    """Data of one import that has a property. Linked data and overrides belong to another file."""
    return [i for i in items if is_own(i) and i.get("osier_bake") == token and name in i]


def manifest_path(collection: bpy.types.Collection) -> str:
    """The manifest of an import. Where the project was moved or copied, it lies above the pictures and stages, whose paths Blender keeps."""
    path, token = collection["osier_manifest"], collection["osier_bake"]
    trees = [m.node_tree for m in marked(bpy.data.materials, token) if m.node_tree]
    files = [node.image for tree in trees for node in tree.nodes if getattr(node, "image", None)]
    files += [u.cache_file for o in marked(bpy.data.objects, token) for u in copies.cache_users(o) if u.cache_file]
    found = []
    for folder in dict.fromkeys(os.path.dirname(os.path.abspath(bpy.path.abspath(file.filepath))) for file in files):
        # Maps of leaves are two folders below the manifest.
        for _ in range(3):
            folder = os.path.dirname(folder)
            above = os.path.join(folder, os.path.basename(path))
            if os.path.isfile(above):
                found.append(above)
                break
    # A material may show a picture of another bake, too.
    is_shown = os.path.realpath(path) in {os.path.realpath(p) for p in found}
    return path if is_shown or not found else found[0]


def is_own(item: bpy.types.ID) -> bool:
    """Whether data belongs to this file, so that changes of it are saved."""
    return item.library is None and item.override_library is None


def _rename_scene(bake: Bake, token: str) -> None:
    """Gives the identifiers of an import the name that its scene has now."""
    for kind in (bpy.data.objects, bpy.data.collections, bpy.data.materials, bpy.data.worlds):
        for item in marked(kind, token):
            item["osier_id"] = f"{bake.scene}:{item['osier_id'].split(':', 1)[1]}"


def _originals(
    collection: bpy.types.Collection, items: list[bpy.types.Object]
) -> tuple[dict[str, bpy.types.Object], dict[str, list[bpy.types.Object]]]:
    """Objects of an import by identifier, and the copies that the user has made of them."""
    home = {o.as_pointer() for o in collection.all_objects}
    old: dict[str, bpy.types.Object] = {}
    twins: dict[str, list[bpy.types.Object]] = {}
    for item in sorted(items, key=lambda o: o.as_pointer() not in home):
        if old.setdefault(item["osier_id"], item) is not item:
            twins.setdefault(item["osier_id"], []).append(item)
    return old, twins


def _deleted(
    collection: bpy.types.Collection, bake: Bake, old: dict[str, bpy.types.Object], objects: list[bpy.types.Object]
) -> set[str]:
    """Identifiers of new objects that the user has deleted, or below such ones. A plant of which nothing is left comes back."""
    known = {f"{bake.scene}:{part}" for part in collection.get("osier_parts", "").split("\n")}
    groups = {a.name: a.group for a in bake.assets if a.is_plant}

    def plant(name: str) -> str | None:
        return groups.get(re.split("[#@/]", name.split(":", 1)[1])[0])

    left = {plant(name) for name in old} | {None}
    gone = {name for name in known - old.keys() if plant(name) in left}
    found = set()
    for item in objects:
        above: bpy.types.Object | None = item
        while above is not None and above.get("osier_id") not in gone:
            above = above.parent
        if above is not None and "osier_id" in item and item["osier_id"] not in old:
            found.add(item["osier_id"])
    return found


def _take_twins(
    twins: dict[str, list[bpy.types.Object]], old: dict[str, bpy.types.Object], objects: list[bpy.types.Object]
) -> list[str]:
    """Gives the user's copies of objects what the new objects show. Copies that share data go on to share it."""
    new = {o["osier_id"]: o for o in objects if "osier_id" in o}
    shown: dict[tuple[bpy.types.ID, bpy.types.ID], bpy.types.ID] = {}
    actions, gone = set(), []
    for name, copied in twins.items():
        item = new.get(name)
        for twin in copied:
            if item is None or item.type != twin.type:
                gone.append(twin)
                continue
            data, earlier = item.data, twin.data
            if data is not None and item.type not in ("CAMERA", "LIGHT") and earlier != old[name].data:
                # Its slots may have other materials than those of the original.
                data = shown.get((earlier, item.data)) or item.data.copy()
                shown[earlier, item.data] = data
            actions.update(_actions(twin))
            _take(twin, item, data)
    before_data = {earlier for earlier, _ in shown} | {o.data for o in gone if o.data}
    removed = len(gone)
    bpy.data.batch_remove(gone)
    _remove_unused(before_data, actions)
    return [f"removed {removed} copied objects that the bake does not have any more"] if removed else []


def _reload_pictures(bake: Bake) -> None:
    """Reads pictures of the bake again that changed materials or the user's own still show, except painted and packed ones."""
    for image in bpy.data.images:
        if is_own(image) and image.filepath and not image.is_dirty and not image.packed_file and stage.is_below(bake, image.filepath):
            image.reload()


def _set_view(bake: Bake, token: str, collection: bpy.types.Collection, scenes: list[bpy.types.Scene]) -> list[str]:
    """Sky, frame rate and range, unless the user has changed them."""
    notes = []
    for sky in marked(bpy.data.worlds, token):
        if sky.get("osier_sig") != materials.signature(sky.node_tree):
            notes.append(f"kept the changed world {sky.name}")
        elif bake.view:
            world.build_world(bake, sky)
    earlier = list(collection.get("osier_rate", []))
    for scene in scenes:
        # A scene that the bake was appended to keeps its range, also one that is equal by chance; it has no rate of the bake.
        if earlier and [scene.frame_start, scene.frame_end, scene.frame_step] == list(collection.get("osier_range", [])):
            scene.frame_start, scene.frame_end, scene.frame_step = bake.first, bake.last, bake.step
        if stage.rate(scene) == earlier:
            stage.set_rate(scene, bake)
            collection["osier_rate"] = stage.rate(scene)
        notes += stage.rates(scene, bake)
    return notes


def _release_caches(bake: Bake, token: str) -> tuple[list[tuple[Any, ...]], list[tuple[Any, ...]]]:
    """Detaches cache files: as long as one holds a stage, USD returns the earlier content of its files.

    Returns those of this import and those of other objects that show the same bake, as another import of it.
    """
    released, others = [], []
    files: dict[Any, tuple[str, float, str]] = {}
    mine = set(marked(bpy.data.objects, token))
    for item in bpy.data.objects:
        for user in copies.cache_users(item):
            file = user.cache_file
            if file is None or not (item in mine or stage.is_below(bake, file.filepath)):
                continue
            if file not in files:
                files[file] = (file.filepath, file.frame_offset, file.name)
            (released if item in mine else others).append((item, user.name, user.object_path, *files[file]))
            user.cache_file = None
    _update_layers()
    # A file that the operator has opened counts a user that it does not have.
    users = bpy.data.user_map(subset=set(files)) if files else {}
    bpy.data.batch_remove([f for f in files if not users.get(f)])
    # Evaluated copies of the removed files hold the stage until the next update.
    _update_layers()
    return released, others


def _update_layers() -> None:
    for scene in bpy.data.scenes:
        for layer in scene.view_layers:
            layer.update()


def _restore_caches(released: list[tuple[Any, ...]]) -> None:
    """Makes the detached cache files again."""
    made: dict[str, bpy.types.CacheFile] = {}
    for item, user_name, path, file, offset, name in released:
        if name not in made:
            known = {f.as_pointer() for f in bpy.data.cache_files}
            bpy.ops.cachefile.open(filepath=bpy.path.abspath(file))
            made[name] = next(f for f in bpy.data.cache_files if f.as_pointer() not in known)
            made[name].name, made[name].frame_offset, made[name].filepath = name, offset, file
        for user in copies.cache_users(item):
            if user.name == user_name:
                user.cache_file = made[name]
                user.object_path = path


def _replace(
    collection: bpy.types.Collection,
    temporary: bpy.types.Collection,
    old: dict[str, bpy.types.Object],
    old_groups: dict[str, bpy.types.Collection],
    objects: list[bpy.types.Object],
    added: list[bpy.types.Collection],
    unwanted: set[str],
) -> None:
    """Moves what the new objects show to the earlier ones, and removes the rest and the `unwanted` ones."""
    new = {o["osier_id"]: o for o in objects if "osier_id" in o}
    new_groups = {c["osier_id"]: c for c in added if "osier_id" in c}
    before_data = {o.data for o in old.values() if o.data}
    before_actions = {a for n, o in [*old.items(), *new.items()] if n in old or n in unwanted for a in _actions(o)}
    for name, group in new_groups.items():
        if name in old_groups:
            continue
        # A new kind or prototype: it moves below the earlier collection of its parent.
        for parent_name, parent in [("", temporary), *new_groups.items()]:
            if group.name in parent.children and (parent is temporary or parent_name in old_groups):
                parent.children.unlink(group)
                (collection if parent is temporary else old_groups[parent_name]).children.link(group)
    shown: dict[tuple[bpy.types.ID, bpy.types.ID], bpy.types.ID] = {}
    taken = set()
    for name, item in new.items():
        mine = old.get(name)
        if mine is not None and mine.type == item.type:
            data, earlier = item.data, mine.data
            if data is not None and mine.type not in ("CAMERA", "LIGHT"):
                # Copies that the user has given data of their own keep some: its slots may have other materials.
                if (earlier, data) not in shown:
                    shown[earlier, data] = data.copy() if data in taken else data
                    taken.add(data)
                data = shown[earlier, item.data]
            _take(mine, item, data)
            continue
        if name in unwanted:
            continue
        for home in list(item.users_collection):
            target = collection if home is temporary else old_groups.get(home.get("osier_id", ""))
            if target is not None and target is not home:
                home.objects.unlink(item)
                target.objects.link(item)
        parent = item.parent and old.get(item.parent.get("osier_id", ""))
        if parent:
            basis, inverse = item.matrix_basis.copy(), item.matrix_parent_inverse.copy()
            item.parent = parent
            item.matrix_parent_inverse, item.matrix_basis = inverse, basis
        for modifier in item.modifiers:
            if modifier.type == "ARMATURE" and modifier.object:
                modifier.object = old.get(modifier.object.get("osier_id", ""), modifier.object)
    gone = [o for n, o in old.items() if n not in new or new[n].type != o.type]
    spare = [o for n, o in new.items() if n in unwanted or (n in old and old[n].type == o.type)]
    groups = [g for m in (o.modifiers for o in spare) for g in (x.node_group for x in m if x.type == "NODES") if g]
    # Data of cameras and lights is not handed over: only its values are.
    before_data |= {o.data for o in spare if o.data}
    bpy.data.batch_remove(gone + spare)
    for name, group in new_groups.items():
        if name in old_groups:
            earlier, wanted = old_groups[name], group.name
            # Added objects, such as another copy of a tree, show the leaves of their kind from the earlier collection.
            group.user_remap(earlier)
            bpy.data.collections.remove(group)
            if earlier.name[:4].isdigit():
                earlier.name = materials.base_name(wanted)
    # A new collection is empty if the user has deleted its objects with the earlier one.
    empty = [g for n, g in old_groups.items() if n not in new_groups and not g.all_objects]
    empty += [g for n, g in new_groups.items() if n not in old_groups and not g.all_objects]
    bpy.data.batch_remove([*empty, temporary])
    bpy.data.batch_remove([g for g in groups if g.users == 0])
    _remove_unused(before_data, before_actions)


def _actions(item: bpy.types.Object) -> list[bpy.types.Action]:
    data = item.animation_data
    if not data:
        return []
    strips = [s.action for t in data.nla_tracks for s in t.strips if s.action]
    return [*strips, data.action] if data.action else strips


def _take(mine: bpy.types.Object, item: bpy.types.Object, data: bpy.types.ID | None) -> None:
    """Gives the earlier object what the new one shows. `data`: that of the new one, or a copy of it."""
    if mine.type in ("CAMERA", "LIGHT"):
        _take_view(mine, item)
    elif data is not None and mine.data is not data:
        _keep_own_materials(mine.data, data)
        mine.data = data
    if _untouched(mine):
        mine.matrix_basis = item.matrix_basis
    mine["osier_base"] = [v for row in item.matrix_basis for v in row]
    _take_animation(mine, item)
    for source in item.modifiers:
        target = mine.modifiers.get(source.name)
        if target is None or target.type != source.type:
            if source.type == "MESH_SEQUENCE_CACHE":
                target = mine.modifiers.new(source.name, source.type)
                mine.modifiers.move(len(mine.modifiers) - 1, 0)
            else:
                continue
        if source.type == "MESH_SEQUENCE_CACHE":
            target.cache_file, target.object_path = source.cache_file, source.object_path
            target.read_data = source.read_data
    for source in item.constraints:
        target = mine.constraints.get(source.name)
        if source.type == "TRANSFORM_CACHE" and target and target.type == source.type:
            target.cache_file, target.object_path = source.cache_file, source.object_path


def _untouched(item: bpy.types.Object) -> bool:
    """Whether an object stands where the import had put it."""
    base = item.get("osier_base")
    if base is None:
        return False
    was = Matrix([base[i : i + 4] for i in range(0, 16, 4)])
    return all(abs(a - b) < 1e-6 for x, y in zip(was, item.matrix_basis, strict=True) for a, b in zip(x, y, strict=True))


def _keep_own_materials(earlier: Any, data: Any) -> None:
    """Materials that the user has put into slots stay there."""
    if not hasattr(data, "materials"):
        return
    for i, material in enumerate(earlier.materials):
        if material is not None and "osier_bake" not in material and i < len(data.materials):
            data.materials[i] = material


def _take_animation(mine: bpy.types.Object, item: bpy.types.Object) -> None:
    source = item.animation_data
    if source is None:
        return
    target = mine.animation_data or mine.animation_data_create()
    target.action = source.action
    if source.action and hasattr(source, "action_slot"):
        target.action_slot = source.action_slot
    strips = {s.name: s for t in source.nla_tracks for s in t.strips if t.name.startswith("osier clip")}
    for track in [t for t in target.nla_tracks if t.name.startswith("osier clip")]:
        for strip in track.strips:
            other = strips.get(strip.name) or next(iter(strips.values()), None)
            if other is None:
                continue
            strip.action = other.action
            if hasattr(strip, "action_slot"):
                strip.action_slot = other.action_slot
            for name in ("action_frame_start", "action_frame_end", "repeat", "frame_start", "frame_end"):
                setattr(strip, name, getattr(other, name))


def _take_view(mine: bpy.types.Object, item: bpy.types.Object) -> None:
    """Values of camera and sun, unless the user has changed them."""
    if world.values(mine) == mine.get("osier_view"):
        for name in world.VALUES[mine.type]:
            setattr(mine.data, name, getattr(item.data, name))
    mine["osier_view"] = item["osier_view"]
    if mine.type == "LIGHT" and _untouched(mine):
        mine.rotation_mode = item.rotation_mode


def _remove_unused(data: set[bpy.types.ID], actions: set[bpy.types.Action]) -> None:
    """Removes data that objects have shown before and nothing uses any more."""
    for action in actions:
        if action.users == 0:
            bpy.data.actions.remove(action)
    bpy.data.batch_remove([d for d in data if d.users == 0])
