# SPDX-License-Identifier: GPL-3.0-or-later
"""Camera, sun, sky and display of a bake."""

import math

import bpy
from mathutils import Matrix, Vector

from .manifest import Bake
from .materials import new_node, signature

# A quarter turn about X: (x, y, z) of the scene becomes (x, -z, y) of Blender.
TURN = Matrix.Rotation(math.pi / 2, 4, "X")


def matrix(numbers: list[float] | tuple[float, ...]) -> Matrix:
    """A matrix of the manifest, for row vectors, as one of Blender, for column vectors; axes stay the scene's."""
    return Matrix([numbers[i : i + 4] for i in range(0, 16, 4)]).transposed()


def set_look(scene: bpy.types.Scene, look: str) -> list[str]:
    """PREVIEW is closest to the curve of `osier preview`; AGX is Blender's own; KEEP changes nothing. Returns notes for the user."""
    wanted = {
        "PREVIEW": ("Filmic", ("High Contrast", "Filmic - High Contrast"), 0.0),
        "AGX": ("AgX", ("AgX - Medium High Contrast", "Medium High Contrast"), 0.3),
    }.get(look)
    if wanted is None:
        return []
    view, names, exposure = wanted
    settings = scene.view_settings
    # Blender 3.4 has no AgX.
    for transform in (view, "Filmic"):
        try:
            settings.view_transform = transform
            break
        except TypeError:
            continue
    else:
        return [f"the OpenColorIO configuration has no view transform {view}: the scene keeps {settings.view_transform}"]
    for name in names:
        try:
            settings.look = name
            break
        except TypeError:
            continue
    settings.exposure, settings.gamma = exposure, 1.0
    return []


def camera_object(bake: Bake) -> bpy.types.Object:
    """The scene's camera."""
    entry = bake.view["camera"]
    data = bpy.data.cameras.new(f"{bake.scene} camera")
    data.sensor_fit = "VERTICAL"
    data.angle = math.radians(entry["vfov_deg"])
    data.clip_start, data.clip_end = entry["clip"]
    camera = bpy.data.objects.new(data.name, data)
    camera.matrix_basis = TURN @ matrix(entry["matrix"])
    return camera


def sun_object(bake: Bake) -> bpy.types.Object:
    """The sun."""
    entry = bake.view["sun"]
    energy = max(entry["irradiance"])
    data = bpy.data.lights.new(f"{bake.scene} sun", "SUN")
    data.energy = energy
    data.color = [c / energy for c in entry["irradiance"]] if energy > 0 else (1.0, 1.0, 1.0)
    data.angle = math.radians(entry["angle_deg"])
    sun = bpy.data.objects.new(data.name, data)
    toward = TURN.to_3x3() @ Vector(entry["toward"])
    sun.rotation_mode = "QUATERNION"
    sun.rotation_quaternion = toward.to_track_quat("Z", "Y")
    return sun


VALUES = {
    "CAMERA": ("sensor_fit", "angle", "clip_start", "clip_end"),
    "LIGHT": ("energy", "color", "angle"),
}
"""Properties of a camera and of a sun that the import sets."""


def values(item: bpy.types.Object) -> str:
    """The values of a camera or a sun as text, to find whether they were changed."""
    found = [getattr(item.data, name) for name in VALUES[item.type]]
    return repr([v if isinstance(v, (str, float)) else [round(c, 6) for c in v] for v in found])


def build_world(bake: Bake, world: bpy.types.World | None = None) -> bpy.types.World:
    """The sky: a gradient by height with a glow about the sun, as the preview has it."""
    if world is None:
        world = bpy.data.worlds.new(f"{bake.scene} sky")
    if bpy.app.version < (5, 0, 0):
        world.use_nodes = True
    tree, sky = world.node_tree, bake.view["sky"]
    tree.nodes.clear()
    coords = new_node(tree, "ShaderNodeTexCoord", "direction", -1100, 200)
    split = new_node(tree, "ShaderNodeSeparateXYZ", "height", -900, 300)
    tree.links.new(coords.outputs["Generated"], split.inputs[0])
    rise = new_node(tree, "ShaderNodeMapRange", "position", -700, 300)
    rise.inputs["From Min"].default_value = -1.0
    tree.links.new(split.outputs["Z"], rise.inputs["Value"])
    ramp = new_node(tree, "ShaderNodeValToRGB", "sky", -500, 300)
    _stops(ramp, [(at, color) for at, color in sky["stops"]])
    tree.links.new(rise.outputs[0], ramp.inputs[0])
    color = ramp.outputs["Color"]
    if sky.get("glow") and sky.get("glow_stops"):
        dot = new_node(tree, "ShaderNodeVectorMath", "towards the sun", -900, -100)
        dot.operation = "DOT_PRODUCT"
        tree.links.new(coords.outputs["Generated"], dot.inputs[0])
        dot.inputs[1].default_value = TURN.to_3x3() @ Vector(bake.view["sun"]["toward"])
        share = new_node(tree, "ShaderNodeValToRGB", "glow", -700, -100)
        _stops(share, [(at, (v, v, v)) for at, v in sky["glow_stops"]])
        tree.links.new(dot.outputs["Value"], share.inputs[0])
        mix = new_node(tree, "ShaderNodeMix", "sky and glow", -200, 200)
        mix.data_type = "RGBA"
        mix.clamp_factor = True
        a, b = (next(s for s in mix.inputs if s.name == n and s.type == "RGBA") for n in "AB")
        tree.links.new(share.outputs["Color"], next(s for s in mix.inputs if s.name == "Factor" and s.type == "VALUE"))
        tree.links.new(color, a)
        b.default_value = (*sky["glow"], 1.0)
        color = next(s for s in mix.outputs if s.type == "RGBA")
    light = new_node(tree, "ShaderNodeBackground", "light", 0, 200)
    light.inputs["Strength"].default_value = 1.0
    tree.links.new(color, light.inputs["Color"])
    out = new_node(tree, "ShaderNodeOutputWorld", "output", 250, 200)
    tree.links.new(light.outputs[0], out.inputs["Surface"])
    reflected = _ground_light(bake)
    if reflected:
        _add_ground_light(tree, reflected)
    world["osier_id"] = f"{bake.scene}:sky"
    world["osier_sig"] = signature(tree)
    return world


def _ground_light(bake: Bake) -> list[float] | None:
    """Radiance of the land of a bake, which reflects its sun and its sky as a diffuse surface; `None` without land."""
    if not any(a.is_land for a in bake.assets):
        return None
    albedo = next((m["base_color"] for m in bake.materials if m["class"] == "ground"), None)
    if albedo is None:
        return None
    sun, stops = bake.view["sun"], bake.view["sky"]["stops"]
    # Half of the stops are below the horizon, which is at 0.5.
    above = [color for at, color in stops if at >= 0.5] or [stops[-1][1]]
    sky = [(low + high) / 2.0 for low, high in zip(above[0], above[-1], strict=True)]
    height = max(sun["toward"][1], 0.0)
    return [a * (e * height / math.pi + s) for a, e, s in zip(albedo, sun["irradiance"], sky, strict=True)]


def _add_ground_light(tree: bpy.types.NodeTree, radiance: list[float]) -> None:
    """An output for EEVEE in which light from below the horizon is that of the land. Rays of Cycles meet the land; EEVEE lights all surfaces
    by the whole sky, and crowns, which it would light from below as brightly as the horizon is, would be pale. The camera sees the sky.
    """
    path = new_node(tree, "ShaderNodeLightPath", "path", -500, -450)
    below = new_node(tree, "ShaderNodeMath", "below the horizon", -500, -250)
    below.operation = "LESS_THAN"
    below.inputs[1].default_value = 0.0
    tree.links.new(tree.nodes["osier height"].outputs["Z"], below.inputs[0])
    lights = new_node(tree, "ShaderNodeMath", "lights from below", -250, -250)
    lights.operation = "SUBTRACT"
    lights.use_clamp = True
    tree.links.new(below.outputs[0], lights.inputs[0])
    tree.links.new(path.outputs["Is Camera Ray"], lights.inputs[1])
    land = new_node(tree, "ShaderNodeBackground", "light of the land", 0, -250)
    land.inputs["Color"].default_value = (*radiance, 1.0)
    mix = new_node(tree, "ShaderNodeMixShader", "sky or land", 250, -100)
    tree.links.new(lights.outputs[0], mix.inputs[0])
    tree.links.new(tree.nodes["osier light"].outputs[0], mix.inputs[1])
    tree.links.new(land.outputs[0], mix.inputs[2])
    out = new_node(tree, "ShaderNodeOutputWorld", "output of EEVEE", 500, -100)
    out.target = "EEVEE"
    tree.links.new(mix.outputs[0], out.inputs["Surface"])


def _stops(node: bpy.types.Node, stops: list[tuple[float, tuple[float, float, float]]]) -> None:
    """Sets the stops of a ramp, at most 32, which is Blender's limit."""
    ramp = node.color_ramp
    ramp.interpolation = "LINEAR"
    while len(ramp.elements) > 1:
        ramp.elements.remove(ramp.elements[-1])
    for i, (at, color) in enumerate(stops[:32]):
        element = ramp.elements[0] if i == 0 else ramp.elements.new(at)
        element.position = at
        element.color = (*color, 1.0)
