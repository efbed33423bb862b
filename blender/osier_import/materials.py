# SPDX-License-Identifier: GPL-3.0-or-later
"""Builds materials from the manifest of a bake."""

import hashlib
import os
import re
from collections.abc import Iterable
from typing import Any

import bpy

from .manifest import Bake, Sequence


DEEPEST = 0.55
"""Colour of a leaf in the deepest shade of its crown as a share of that of one outside; own."""


def base_name(name: str) -> str:
    """A name without the number that Blender appends to equal names; osier's names have no dot."""
    head, dot, tail = name.rpartition(".")
    return head if dot and tail.isdigit() else name


def build_all(bake: Bake, token: str, existing: dict[str, bpy.types.Material], kept: list[str]) -> dict[str, bpy.types.Material]:
    """The materials of a bake by name. `token` marks those of one import.

    `existing` are earlier materials of the same import: they are rebuilt, unless somebody has changed them; `kept` then gets
    their names.
    """
    built = {}
    for entry in bake.materials:
        material = existing.get(entry["name"])
        if material is None:
            material = bpy.data.materials.new(entry["name"])
        elif material.get("osier_sig") != signature(material.node_tree):
            kept.append(material.name)
            _follow_frames(material, bake, entry)
            built[entry["name"]] = material
            continue
        build(material, bake, entry)
        material["osier_id"] = f"{bake.scene}:{entry['name']}"
        material["osier_bake"] = token
        material["osier_sig"] = signature(material.node_tree)
        material["osier_name"] = material.name
        built[entry["name"]] = material
    return built


def remove_unused(items: Iterable[bpy.types.Material]) -> None:
    """Removes the materials that no object has, as that of dead wood of a tree without any: Blender would show them with 0 users."""
    bpy.data.batch_remove([material for material in items if material.users == 0])


def originals(items: Iterable[bpy.types.Material]) -> dict[str, bpy.types.Material]:
    """The materials of an import by their names in the bake. Copies that the user has made have the identifier of their original, but
    neither its name nor, once they are changed, its nodes.
    """
    found: dict[str, list[bpy.types.Material]] = {}
    for material in items:
        found.setdefault(material["osier_id"].split(":", 1)[1], []).append(material)

    def distance(material: bpy.types.Material) -> tuple[bool, bool]:
        return (material.name != material.get("osier_name"), material.get("osier_sig") != signature(material.node_tree))

    return {name: min(same, key=distance) for name, same in found.items()}


def _follow_frames(material: bpy.types.Material, bake: Bake, entry: dict[str, Any]) -> None:
    """Gives the image sequences of a changed material the frames that the bake has now, unless the user has set other ones."""
    tree = material.node_tree
    for name, node_name in (("wetness", "osier wetness"), ("normal", "osier normal picture")):
        sequence, node = bake.sequences.get(entry["maps"].get(name, "")), tree and tree.nodes.get(node_name)
        image, user = getattr(node, "image", None), getattr(node, "image_user", None)
        if sequence is None or image is None or image.source != "SEQUENCE":
            continue
        path, wanted = bpy.path.abspath(image.filepath), bake.file(sequence.path(sequence.first))
        shown = re.search(r"([0-9]+)\.[a-z]+$", path)
        is_of_bake = os.path.realpath(os.path.dirname(path)) == os.path.realpath(os.path.dirname(wanted))
        if shown and is_of_bake and (user.frame_start, user.frame_offset) == (int(shown[1]), int(shown[1]) - 1):
            image.filepath = wanted
            _set_frames(user, sequence)


def build(material: bpy.types.Material, bake: Bake, entry: dict[str, Any]) -> None:
    """Replaces the nodes of a material."""
    if bpy.app.version < (5, 0, 0):
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    if entry["class"] == "water":
        _water(tree)
        # Of EEVEE, from 4.2 and before.
        set_if_known(material, "use_raytrace_refraction", True)
        set_if_known(material, "use_screen_refraction", True)
    else:
        _surface(tree, bake, entry)
    color = entry["base_color"]
    material.diffuse_color = (*color, 1.0)
    material.roughness = entry["roughness"]


def signature(tree: bpy.types.NodeTree | None) -> str:
    """A hash of the types, links and values of the nodes of a tree. Empty without one: materials have none before Blender 5 at first."""
    if tree is None:
        return ""
    lines = []
    for node in tree.nodes:
        values = [_value(s) for s in node.inputs] + [_value(s) for s in node.outputs]
        options = [getattr(node, o, "") for o in ("operation", "blend_type", "data_type", "interpolation_type", "mute")]
        image, ramp = getattr(node, "image", None), getattr(node, "color_ramp", None)
        # Reading the image by its file: the same picture stays the same when its name gets a number.
        options.append(os.path.basename(image.filepath) if image else "")
        user = getattr(node, "image_user", None)
        if user:
            options += [user.frame_start, user.frame_duration, user.frame_offset]
        if ramp:
            options += [(round(e.position, 5), [round(c, 5) for c in e.color]) for e in ramp.elements]
        lines.append(repr((node.bl_idname, node.name, options, values)))
    for link in tree.links:
        ends = (link.from_node.name, link.from_socket.identifier, link.to_node.name, link.to_socket.identifier)
        lines.append(repr(ends))
    return hashlib.sha256("\n".join(sorted(lines)).encode()).hexdigest()[:32]


def _value(socket: bpy.types.NodeSocket) -> Any:
    value = getattr(socket, "default_value", None)
    if value is None or isinstance(value, (bool, int, str)):
        return value
    if isinstance(value, float):
        return round(value, 5)
    try:
        return [round(v, 5) for v in value]
    except TypeError:
        return getattr(value, "name", str(type(value)))


def set_if_known(target: Any, name: str, value: Any) -> None:
    """Sets a property that not every version of Blender has."""
    if hasattr(target, name):
        setattr(target, name, value)


def socket(node: bpy.types.Node, *names: str) -> bpy.types.NodeSocket:
    """The input of the first of `names` that the node has: names differ between versions."""
    return next(node.inputs[name] for name in names if name in node.inputs)


def new_node(tree: bpy.types.NodeTree, kind: str, name: str, x: float, y: float) -> bpy.types.Node:
    """Adds a node of a type and a name, at a position."""
    node = tree.nodes.new(kind)
    node.name = node.label = f"osier {name}"
    node.location = (x, y)
    return node


def picture(path: str, color: bool, sequence: Sequence | None = None) -> bpy.types.Image:
    """The picture of a file; a sequence is a separate picture, because its settings differ."""
    image = bpy.data.images.load(path, check_existing=sequence is None)
    _set_space(image, color)
    if sequence:
        image.source = "SEQUENCE"
    return image


def _set_space(image: bpy.types.Image, color: bool) -> None:
    """Sets the colour space of a picture: sRGB, or none for data. Their names differ between configurations of OpenColorIO."""
    if not color:
        image.colorspace_settings.is_data = True
        return
    try:
        image.colorspace_settings.name = "sRGB"
    except TypeError:
        # The configuration of a studio has another name: Blender has given the picture the space of 8-bit pictures.
        pass


def _picture_node(tree: bpy.types.NodeTree, bake: Bake, file: str, name: str, color: bool, y: float) -> bpy.types.Node:
    node = new_node(tree, "ShaderNodeTexImage", name, -900, y)
    sequence = bake.sequences.get(file)
    if sequence is None:
        node.image = picture(bake.file(file), color)
        return node
    node.image = picture(bake.file(sequence.path(sequence.first)), color, sequence)
    user = node.image_user
    _set_frames(user, sequence)
    user.use_auto_refresh = True
    user.use_cyclic = False
    node.extension = "EXTEND"
    return node


def _set_frames(user: bpy.types.ImageUser, sequence: Sequence) -> None:
    """Shows each picture of a sequence at its frame."""
    user.frame_start = sequence.first
    user.frame_duration = sequence.last - sequence.first + 1
    user.frame_offset = sequence.first - 1


def _mix(tree: bpy.types.NodeTree, kind: str, name: str, x: float, y: float) -> tuple[Any, Any, Any, Any]:
    """A Mix node of a data type with the sockets factor, A, B and result of that type."""
    node = new_node(tree, "ShaderNodeMix", name, x, y)
    node.data_type = kind
    wanted = "RGBA" if kind == "RGBA" else "VALUE"
    a, b = (next(s for s in node.inputs if s.name == n and s.type == wanted) for n in "AB")
    factor = next(s for s in node.inputs if s.name == "Factor" and s.type == "VALUE")
    result = next(s for s in node.outputs if s.type == wanted)
    return factor, a, b, result


def _join(tree: bpy.types.NodeTree, source: Any, target: bpy.types.NodeSocket) -> None:
    """Links `source` if it is a socket, else sets it as the value of `target`."""
    if isinstance(source, bpy.types.NodeSocket):
        tree.links.new(source, target)
    else:
        target.default_value = source


def _surface(tree: bpy.types.NodeTree, bake: Bake, entry: dict[str, Any]) -> None:
    """Bark, leaves, ground and hairs: wet parts are darker and smoother; translucent ones transmit light."""
    slots, maps, t = entry["slots"], entry["maps"], entry["translucency"]
    color: Any = (*entry["base_color"], 1.0)
    rough: Any = entry["roughness"]
    alpha = None
    if "color" in slots:
        node = _picture_node(tree, bake, slots["color"], "color", True, 500)
        color, alpha = node.outputs["Color"], node.outputs["Alpha"]
    if "rough" in slots:
        rough = _picture_node(tree, bake, slots["rough"], "rough", False, 200).outputs["Color"]
    if entry["vertex_colors"]:
        color = _point_colors(tree, color, replaces=entry["name"] in {a.points_material for a in bake.assets})
    if entry["class"] == "leaf" and bake.is_occluded():
        color = _occluded(tree, color)
    if "wetness" in maps:
        wetness = _picture_node(tree, bake, maps["wetness"], "wetness", False, -100).outputs["Color"]
        factor, a, b, result = _mix(tree, "RGBA", "wet color", -500, 500)
        factor.node.blend_type = "MULTIPLY"
        tree.links.new(wetness, factor)
        _join(tree, color, a)
        albedo = entry.get("wet_albedo")
        b.default_value = (*(bake.wet_albedo if albedo is None else float(albedo),) * 3, 1.0)
        color = result
        factor, a, b, result = _mix(tree, "FLOAT", "wet rough", -500, 200)
        tree.links.new(wetness, factor)
        _join(tree, rough, a)
        wet_rough = entry.get("wet_roughness")
        b.default_value = min(bake.wet_roughness if wet_rough is None else float(wet_rough), entry["roughness"])
        rough = result
    normal = None
    file = maps.get("normal") or slots.get("normal")
    if file:
        image = _picture_node(tree, bake, file, "normal picture", False, -400)
        node = new_node(tree, "ShaderNodeNormalMap", "normal", -500, -100)
        tree.links.new(image.outputs["Color"], node.inputs["Color"])
        normal = node.outputs["Normal"]
    front = new_node(tree, "ShaderNodeBsdfPrincipled", "surface", -200, 300)
    _join(tree, color, front.inputs["Base Color"])
    _join(tree, rough, front.inputs["Roughness"])
    front.inputs["IOR"].default_value = entry["ior"]
    # The mix below weakens the gloss by 1 - t.
    socket(front, "Specular IOR Level", "Specular").default_value = 0.5 / (1.0 - min(t, 0.9))
    if normal:
        tree.links.new(normal, front.inputs["Normal"])
    shader = front.outputs[0]
    if t > 0.0:
        back = new_node(tree, "ShaderNodeBsdfTranslucent", "back", -200, -350)
        _join(tree, color, back.inputs["Color"])
        if normal:
            tree.links.new(normal, back.inputs["Normal"])
        mix = new_node(tree, "ShaderNodeMixShader", "light through", 150, 200)
        mix.inputs[0].default_value = t
        tree.links.new(shader, mix.inputs[1])
        tree.links.new(back.outputs[0], mix.inputs[2])
        shader = mix.outputs[0]
    if entry["alpha_cutoff"] is not None and alpha is not None:
        cut = new_node(tree, "ShaderNodeMath", "cut", -500, -350)
        cut.operation = "GREATER_THAN"
        tree.links.new(alpha, cut.inputs[0])
        cut.inputs[1].default_value = entry["alpha_cutoff"]
        shader = _cut_out(tree, shader, cut.outputs[0], front, t)
    out = new_node(tree, "ShaderNodeOutputMaterial", "output", 700, 200)
    tree.links.new(shader, out.inputs["Surface"])


def _point_colors(tree: bpy.types.NodeTree, color: Any, replaces: bool) -> Any:
    """The colours at the points of a mesh or a cloud, times `color` unless they replace it."""
    read = new_node(tree, "ShaderNodeAttribute", "own color", -1200, 700)
    read.attribute_type = "GEOMETRY"
    read.attribute_name = "displayColor"
    if replaces:
        return read.outputs["Color"]
    factor, a, b, result = _mix(tree, "RGBA", "times own color", -700, 900)
    factor.node.blend_type = "MULTIPLY"
    factor.default_value = 1.0
    _join(tree, color, a)
    tree.links.new(read.outputs["Color"], b)
    return result


def _occluded(tree: bpy.types.NodeTree, color: Any) -> Any:
    """A colour that is darker on leaves deep in their crown. Cycles shades them anyhow: there the last colour may be white."""
    read = new_node(tree, "ShaderNodeAttribute", "canopy", -900, 800)
    read.attribute_type = "INSTANCER"
    read.attribute_name = "canopy_occlusion"
    factor, a, b, result = _mix(tree, "RGBA", "canopy color", -600, 700)
    factor.node.blend_type = "MULTIPLY"
    tree.links.new(read.outputs["Fac"], factor)
    _join(tree, color, a)
    b.default_value = (*(DEEPEST,) * 3, 1.0)
    return result


def _cut_out(tree: bpy.types.NodeTree, shader: Any, alpha: Any, front: bpy.types.Node, t: float) -> Any:
    """Cuts a surface out by alpha. The alpha of the front alone would leave the light of the back."""
    if t == 0.0:
        tree.links.new(alpha, front.inputs["Alpha"])
        return shader
    clear = new_node(tree, "ShaderNodeBsdfTransparent", "hole", 150, -100)
    mix = new_node(tree, "ShaderNodeMixShader", "cut out", 400, 100)
    tree.links.new(alpha, mix.inputs[0])
    tree.links.new(clear.outputs[0], mix.inputs[1])
    tree.links.new(shader, mix.inputs[2])
    return mix.outputs[0]


def _water(tree: bpy.types.NodeTree) -> None:
    """Water refracts; light that reaches the surfaces behind passes straight on, because caustics are off."""
    water = new_node(tree, "ShaderNodeBsdfPrincipled", "water", -200, 300)
    water.inputs["Base Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    water.inputs["Roughness"].default_value = 0.0
    water.inputs["IOR"].default_value = 1.333
    socket(water, "Transmission Weight", "Transmission").default_value = 1.0
    water.inputs["Alpha"].default_value = 1.0
    path = new_node(tree, "ShaderNodeLightPath", "path", -500, 0)
    either = new_node(tree, "ShaderNodeMath", "shadow or diffuse", -200, -350)
    either.operation = "MAXIMUM"
    tree.links.new(path.outputs["Is Shadow Ray"], either.inputs[0])
    tree.links.new(path.outputs["Is Diffuse Ray"], either.inputs[1])
    clear = new_node(tree, "ShaderNodeBsdfTransparent", "clear", 0, -350)
    mix = new_node(tree, "ShaderNodeMixShader", "mix", 200, 200)
    tree.links.new(either.outputs[0], mix.inputs[0])
    tree.links.new(water.outputs[0], mix.inputs[1])
    tree.links.new(clear.outputs[0], mix.inputs[2])
    out = new_node(tree, "ShaderNodeOutputMaterial", "output", 450, 200)
    tree.links.new(mix.outputs[0], out.inputs["Surface"])
