# SPDX-License-Identifier: GPL-3.0-or-later
"""Objects of Blender in a scene of osier: solids that stop wind, rain and seeds, and trees that sway."""

import contextlib
import json
import os
import pathlib
import re
import shutil
from collections.abc import Iterator

import bpy
from mathutils import Matrix

from .scene_text import with_headed_tables, without_table

ROLES = [
    ("SOLID", "Solid", "Stops wind, rain and seeds"),
    ("TERRAIN", "Terrain", "The land on which plants, rain and seeds come down, in place of that of the scene; several objects make one land"),
    ("TREE", "Tree", "Gets a skeleton and sways; parts with leaf, blade, needle or frond in their name or material are leaves"),
]
"""What an object can be."""

PLAIN = "without_material"
"""Material of faces without one that follow others in a file, grey as osier's own."""

MARK = ".osier-scene"
"""File that marks a folder that this module has made and may replace."""


def usable(item: bpy.types.Object | None) -> bool:
    """Whether an object has a surface."""
    return item is not None and item.type in ("MESH", "CURVE", "SURFACE", "META", "FONT")


def write_scene(folder: str, name: str, text: str, given: list[str], plants: list[str], items: list) -> str:
    """Writes a scene with objects into the empty `folder` and returns its path.

    `text` is the scene that they are added to, `given` its keys, `plants` the names of its plants; `items` have `object` and `role`.
    """
    tables = []
    if any(item.role == "TREE" for item in items) and not any(key.startswith(("place.", "scatter.")) for key in given):
        # With a place for the tree, the plants of the scene need places of their own: they have stood 4 m apart.
        tables += [f'[[place]]\nplant = {json.dumps(plant)}\nat = [{4 * i}, 0, 0]\n' for i, plant in enumerate(plants)]
    land = [item.object for item in items if item.role == "TERRAIN"]
    if land:
        export(land, os.path.join(folder, "terrain_objects.obj"), (0.0, 0.0, 0.0), instances=False)
        # The table of the scene describes another land; keys that the user has changed in the panel are still checked.
        text = without_table(text, "terrain")
        tables.append('[terrain]\nfile = "terrain_objects.obj"\n')
    for number, item in enumerate(items):
        if item.role == "TERRAIN":
            continue
        word = re.sub(r"\W", "_", item.object.name, flags=re.ASCII)
        file = f"object{number}_{word}.obj"
        position = item.object.matrix_world.translation if item.role == "TREE" else (0.0, 0.0, 0.0)
        export([item.object], os.path.join(folder, file), position)
        if item.role == "TREE":
            # The height is that in Blender, whatever ground or terrain the scene has.
            at = [round(v, 6) for v in (position[0], position[2], -position[1])]
            plant = f"object{number}_{word}"
            tables.append(f'[plants.{plant}]\nmesh = "{file}"\n\n[[place]]\nplant = "{plant}"\nat = {json.dumps(at)}\nheight_from = "zero"\n')
        else:
            tables.append(f'[[solid]]\nname = "object{number}_{word}"\nshape = "mesh"\nmesh = "{file}"\n')
    # Tables with headers cannot be added to those that a scene writes inline.
    for word in ("plants", "place", "solid"):
        text = with_headed_tables(text, word)
    path = os.path.join(folder, f"{name}.toml")
    pathlib.Path(path).write_text(text.rstrip() + "\n\n" + "\n".join(tables), encoding="utf-8")
    return path


def fresh_folder(path: str) -> None:
    """Makes an empty folder. One that is there is removed if this module has made it. Raises `OSError` for another one."""
    if os.path.isdir(path):
        if not os.path.exists(os.path.join(path, MARK)):
            raise FileExistsError(f"{path} is not a folder of this extension")
        shutil.rmtree(path)
    os.makedirs(path)
    pathlib.Path(path, MARK).write_text("Made by the extension osier, which removes this folder at the next bake.\n")


@contextlib.contextmanager
def evaluated(heads: list[bpy.types.Object], instances: bool) -> Iterator[Iterator[tuple[bpy.types.Object, Matrix]]]:
    """The evaluated states of objects, of all below them, and of what they instance if wanted, each with its place. Blender does not
    evaluate what is hidden in all viewports or is in a collection that is switched off: a scene for the moment shows them.
    """
    parts = [part for head in heads for part in (head, *(o for o in head.children_recursive if usable(o)))]
    hidden = [part for part in parts if part.hide_viewport]
    scene = bpy.data.scenes.new("osier export")
    try:
        scene.frame_current = bpy.context.scene.frame_current
        for part in parts:
            part.hide_viewport = False
            if part.name not in scene.collection.objects:
                scene.collection.objects.link(part)
        layer = scene.view_layers[0]
        layer.update()
        yield _states(parts, layer.depsgraph, instances)
    finally:
        for part in hidden:
            part.hide_viewport = True
        bpy.data.scenes.remove(scene)


def _states(parts: list[bpy.types.Object], graph: bpy.types.Depsgraph, instances: bool) -> Iterator[tuple[bpy.types.Object, Matrix]]:
    for part in parts:
        state = part.evaluated_get(graph)
        yield state, state.matrix_world
    for instance in graph.object_instances if instances else ():
        if instance.is_instance and instance.parent.original in parts and usable(instance.object):
            yield instance.object, instance.matrix_world.copy()


def export(heads: list[bpy.types.Object], path: str, origin: tuple[float, float, float], instances: bool = True) -> None:
    """Writes objects, all below them and what they instance as OBJ, +Y up, with `origin` at zero; modifiers are applied."""
    mapping = Matrix(((1, 0, 0, 0), (0, 0, 1, 0), (0, -1, 0, 0), (0, 0, 0, 1))) @ Matrix.Translation(origin).inverted()
    library = pathlib.Path(path).with_suffix(".mtl")
    lines: list[str] = [f"mtllib {library.name}"]
    used: dict[str, bpy.types.Material] = {}
    # In a file a material holds for all faces after it, those of the next object included.
    in_force = None
    count = coordinates = 0
    with evaluated(heads, instances) as parts:
        for state, place in parts:
            mesh = state.to_mesh()
            if mesh is None:
                continue
            place = mapping @ place
            mesh.transform(place)
            if place.determinant() < 0:
                mesh.flip_normals()
            lines.append(f"o {state.name.replace(' ', '_')}")
            lines += ["v {:.7g} {:.7g} {:.7g}".format(*vertex.co) for vertex in mesh.vertices]
            uvs = mesh.uv_layers.active
            if uvs:
                lines += ["vt {:.7g} {:.7g}".format(*loop.uv) for loop in uvs.data]
            slots = [slot.material and slot.material.original for slot in state.material_slots]
            material = None
            for face in mesh.polygons:
                # Modifiers may set materials that the object itself does not have.
                slot = slots[face.material_index] if face.material_index < len(slots) else None
                if slot is None and in_force not in (None, PLAIN):
                    material, in_force = None, PLAIN
                    lines.append(f"usemtl {PLAIN}")
                elif slot is not None and slot.name != material:
                    material = in_force = slot.name
                    used[material] = slot
                    lines.append(f"usemtl {material}")
                lines.append("f " + " ".join(_corner(mesh, i, count, coordinates if uvs else None) for i in face.loop_indices))
            count += len(mesh.vertices)
            coordinates += len(mesh.loops) if uvs else 0
            state.to_mesh_clear()
    pathlib.Path(path).write_text("\n".join(lines) + "\n", encoding="utf-8")
    colors = {name: color_of(slot) for name, slot in used.items()}
    if f"usemtl {PLAIN}" in lines:
        colors.setdefault(PLAIN, (0.5, 0.5, 0.5))
    text = ("newmtl {}\nKd {:.5g} {:.5g} {:.5g}\n".format(name, *color) for name, color in colors.items())
    library.write_text("".join(text), encoding="utf-8")


def color_of(material: bpy.types.Material) -> tuple[float, float, float]:
    """The colour of a material without its textures: that of its first Principled BSDF, else that of the viewport."""
    nodes = material.node_tree.nodes if material.node_tree else ()
    shader = next((node for node in nodes if node.type == "BSDF_PRINCIPLED"), None)
    return tuple((shader.inputs["Base Color"].default_value if shader else material.diffuse_color)[:3])


def _corner(mesh: bpy.types.Mesh, loop: int, count: int, coordinates: int | None) -> str:
    """A corner of a face: its vertex, and its texture coordinates if the mesh has any. Files count from 1."""
    vertex = mesh.loops[loop].vertex_index + count + 1
    return str(vertex) if coordinates is None else f"{vertex}/{coordinates + loop + 1}"
