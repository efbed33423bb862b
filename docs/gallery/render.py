"""Renders a baked file with Cycles on the CPU, as the large picture in the README was made
(--frame 36 --size 1200x675 --samples 64 --sun 36,46 --exposure 0.3 --through 0.3); the small ones are by osier preview.

    python render.py out/showcase/showcase.usda picture.png [--frame 36 [--until 72 --every 2]] [--size 800x800] [--samples 96]
                     [--eye x,y,z --target x,y,z --fov 35] [--plain] [--sun elevation,azimuth]
                     [--haze visibility] [--sky horizon,zenith,below] [--energy sun] [--through leaves]

Needs Blender's Python module (pip install bpy==5.0.1). Positions are osier's: metres, +Y up. Without --eye the file's own
camera is used if it has one, else the bounds are fitted. --plain adds a ground and is meant for single plants. --haze is
a scene's [fog] visibility, m, put into the materials: USD has no word for it. --sky are a scene's [sky] colours,
--through the share of light that leaves let through (`translucency`), which USD's preview surface has no word for either.
"""

import argparse
import math
import os
import re
import sys

import bpy
from mathutils import Vector


def arguments():
    p = argparse.ArgumentParser()
    p.add_argument("source")
    p.add_argument("picture")
    p.add_argument("--frame", type=int)
    p.add_argument("--until", type=int, help="with --frame: a clip up to this frame, as PICTURE with four digits before its ending")
    p.add_argument("--every", type=int, default=1, help="with --until: frames from one picture to the next")
    p.add_argument("--size", default="800x800")
    p.add_argument("--samples", type=int, default=96)
    p.add_argument("--eye")
    p.add_argument("--target")
    p.add_argument("--fov", type=float, default=35.0, help="vertical, degrees")
    p.add_argument("--sun", default="38,135", help="elevation, azimuth from +Z towards +X, degrees")
    p.add_argument("--exposure", type=float, default=0.0)
    p.add_argument("--haze", type=float, help="visibility, m")
    p.add_argument("--plain", action="store_true")
    p.add_argument("--sky", help="horizon, zenith and what stands below the horizon, #rrggbb each")
    p.add_argument("--energy", type=float, default=3.6, help="of the sun, W/m^2")
    p.add_argument("--through", type=float, default=0.0, help="share of light that leaves let through")
    return p.parse_args(sys.argv[1:])


def blender_from_osier(text):
    x, y, z = (float(v) for v in text.split(","))
    return Vector((x, -z, y))


def load(path):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    if path.endswith((".glb", ".gltf")):
        bpy.ops.import_scene.gltf(filepath=path)
    else:
        bpy.ops.wm.usd_import(filepath=path, import_usd_preview=True)


def bounds():
    graph = bpy.context.evaluated_depsgraph_get()
    low, high = Vector((1e9,) * 3), Vector((-1e9,) * 3)
    for instance in graph.object_instances:
        if instance.object.type in {"MESH", "CURVES", "POINTCLOUD"}:
            for corner in instance.object.bound_box:
                p = instance.matrix_world @ Vector(corner)
                low = Vector(map(min, low, p))
                high = Vector(map(max, high, p))
    return low, high


def aim(camera, eye, target, vfov):
    camera.location = eye
    camera.data.clip_start = 0.001
    camera.rotation_mode = "QUATERNION"
    camera.rotation_quaternion = (target - eye).to_track_quat("-Z", "Y")
    camera.data.sensor_fit = "VERTICAL"
    camera.data.angle = vfov


def set_camera(scene, a):
    if a.eye is None:
        cameras = [o for o in bpy.data.objects if o.type == "CAMERA"]
        if cameras:
            # The importer makes the camera but does not look through it.
            scene.camera = cameras[0]
            scene.camera.data.sensor_fit = "VERTICAL"
            return
    camera = bpy.data.objects.new("view", bpy.data.cameras.new("view"))
    scene.collection.objects.link(camera)
    scene.camera = camera
    vfov = math.radians(a.fov)
    if a.eye:
        aim(camera, blender_from_osier(a.eye), blender_from_osier(a.target), vfov)
        return
    low, high = bounds()
    middle, radius = (low + high) / 2, (high - low).length / 2
    out = Vector((math.sin(0.45), -math.cos(0.45), 0.18)).normalized()
    aim(camera, middle + out * radius / math.sin(vfov / 2), middle, vfov)


def set_light(scene, a):
    for o in [o for o in bpy.data.objects if o.type == "LIGHT"]:
        bpy.data.objects.remove(o)
    elevation, azimuth = (math.radians(float(v)) for v in a.sun.split(","))
    sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    sun.data.energy, sun.data.angle, sun.data.color = a.energy, math.radians(0.6), (1.0, 0.95, 0.86)
    x, y, z = math.cos(elevation) * math.sin(azimuth), math.sin(elevation), math.cos(elevation) * math.cos(azimuth)
    sun.rotation_mode = "QUATERNION"
    sun.rotation_quaternion = Vector((x, -z, y)).to_track_quat("Z", "Y")
    scene.collection.objects.link(sun)
    world = bpy.data.worlds.new("sky")
    scene.world = world
    world.use_nodes = True
    nodes, links = world.node_tree.nodes, world.node_tree.links
    ramp = nodes.new("ShaderNodeValToRGB")
    ramp.color_ramp.elements[0].color = (0.66, 0.8, 1.0, 1)
    ramp.color_ramp.elements[1].color = (0.16, 0.36, 0.86, 1)
    ramp.color_ramp.elements[1].position = 0.7
    split = nodes.new("ShaderNodeSeparateXYZ")
    coords = nodes.new("ShaderNodeTexCoord")
    links.new(coords.outputs["Generated"], split.inputs[0])
    links.new(split.outputs["Z"], ramp.inputs[0])
    links.new(ramp.outputs[0], nodes["Background"].inputs["Color"])
    nodes["Background"].inputs["Strength"].default_value = 0.75


def set_sky(scene, colors):
    """A soft edge between the sky and what stands below the horizon, as POV-Ray's files have it."""
    def linear(text):
        parts = (int(text.strip("#")[i : i + 2], 16) / 255 for i in (0, 2, 4))
        return [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts] + [1]

    horizon, zenith, below = (linear(c) for c in colors.split(","))
    nodes, links = scene.world.node_tree.nodes, scene.world.node_tree.links
    ramp = next(n for n in nodes if n.type == "VALTORGB")
    rise = nodes.new("ShaderNodeMapRange")
    rise.inputs["From Min"].default_value = -1.0
    links.new(ramp.inputs[0].links[0].from_socket, rise.inputs["Value"])
    links.new(rise.outputs[0], ramp.inputs[0])
    stops = ramp.color_ramp.elements
    stops[0].color = [c * 0.4 for c in below[:3]] + [1]
    stops[1].position, stops[1].color = 1.0, zenith
    for position, color in ((0.38, below), (0.55, horizon)):
        stops.new(position).color = color
    nodes["Background"].inputs["Strength"].default_value = 1.0


def bend_light():
    """Water bends light: the preview surface knows only how much it hides."""
    for material in bpy.data.materials:
        surface = material.node_tree and next((n for n in material.node_tree.nodes if n.type == "BSDF_PRINCIPLED"), None)
        if not surface or not material.name.startswith("water"):
            continue
        for name, value in (("Alpha", 1.0), ("Transmission Weight", 1.0), ("Roughness", 0.0), ("IOR", 1.333)):
            for link in list(surface.inputs[name].links):
                material.node_tree.links.remove(link)
            surface.inputs[name].default_value = value
        surface.inputs["Base Color"].default_value = (0.985, 0.995, 0.99, 1)


def shine_through(share):
    """Lets light through leaves."""
    for material in bpy.data.materials:
        if not material.node_tree or not re.search(r"_l\d+|leaf", material.name) or "bark" in material.name:
            continue
        nodes, links = material.node_tree.nodes, material.node_tree.links
        surface = next((n for n in nodes if n.type == "BSDF_PRINCIPLED"), None)
        out = next((n for n in nodes if n.type == "OUTPUT_MATERIAL"), None)
        if surface is None or out is None:
            continue
        back, mix = nodes.new("ShaderNodeBsdfTranslucent"), nodes.new("ShaderNodeMixShader")
        color = surface.inputs["Base Color"]
        if color.links:
            links.new(color.links[0].from_socket, back.inputs["Color"])
        else:
            back.inputs["Color"].default_value = color.default_value
        mix.inputs[0].default_value = share
        links.new(surface.outputs[0], mix.inputs[1])
        links.new(back.outputs[0], mix.inputs[2])
        links.new(mix.outputs[0], out.inputs["Surface"])


def add_haze(scene, visibility):
    """Mixes what the camera sees with the colour of the horizon: of light from a distance d, exp(-3.912 d / visibility)
    arrives."""
    haze = (0.58, 0.71, 0.82, 1)
    ramp = next(n for n in scene.world.node_tree.nodes if n.type == "VALTORGB")
    ramp.color_ramp.elements[0].color = haze
    for material in bpy.data.materials:
        nodes, links = material.node_tree.nodes, material.node_tree.links
        out = next((n for n in nodes if n.type == "OUTPUT_MATERIAL" and n.inputs["Surface"].links), None)
        if out is None:
            continue
        path, arrives, hidden = (nodes.new(f"ShaderNode{kind}") for kind in ("LightPath", "Math", "Math"))
        arrives.operation = "POWER"
        arrives.inputs[0].default_value = math.exp(-3.912 / visibility)
        links.new(path.outputs["Ray Length"], arrives.inputs[1])
        # Only what the camera sees: camera - arrives * camera.
        hidden.operation = "MULTIPLY_ADD"
        invert = nodes.new("ShaderNodeMath")
        invert.operation = "MULTIPLY"
        invert.inputs[1].default_value = -1.0
        links.new(arrives.outputs[0], invert.inputs[0])
        camera = path.outputs["Is Camera Ray"]
        links.new(invert.outputs[0], hidden.inputs[0])
        links.new(camera, hidden.inputs[1])
        links.new(camera, hidden.inputs[2])
        light, mix = nodes.new("ShaderNodeEmission"), nodes.new("ShaderNodeMixShader")
        light.inputs["Color"].default_value = haze
        light.inputs["Strength"].default_value = 0.75
        links.new(hidden.outputs[0], mix.inputs[0])
        links.new(out.inputs["Surface"].links[0].from_socket, mix.inputs[1])
        links.new(light.outputs[0], mix.inputs[2])
        links.new(mix.outputs[0], out.inputs["Surface"])


def show_maps(scene):
    """Gives wet leaves the maps of the frame, of which the importer takes the first only, and makes wet places darker:
    USD's preview surface has no word for that."""
    for material in bpy.data.materials:
        if not material.node_tree:
            continue
        nodes, links = material.node_tree.nodes, material.node_tree.links
        for node in [n for n in nodes if n.type == "TEX_IMAGE" and n.image]:
            path = bpy.path.abspath(node.image.filepath)
            found = re.search(r"([/\\])(wetness|normal)\.(\d+)\.exr$", path)
            if not found:
                continue
            number = str(scene.frame_current).zfill(len(found[3]))
            node.image = bpy.data.images.load(f"{path[:found.start()]}{found[1]}{found[2]}.{number}.exr")
            node.image.colorspace_settings.name = "Non-Color"
            surface = next((n for n in nodes if n.type == "BSDF_PRINCIPLED"), None)
            if found[2] != "wetness" or surface is None:
                continue
            color, mix = surface.inputs["Base Color"], nodes.new("ShaderNodeMix")
            mix.data_type, mix.blend_type = "RGBA", "MULTIPLY"
            dry, wet = (s for s in mix.inputs if s.name in "AB" and s.type == "RGBA")
            dry.default_value, wet.default_value = color.default_value, (0.55, 0.55, 0.55, 1)
            if color.links:
                links.new(color.links[0].from_socket, dry)
            links.new(node.outputs["Color"], mix.inputs["Factor"])
            links.new(next(s for s in mix.outputs if s.type == "RGBA"), color)


def add_ground(scene):
    low, _ = bounds()
    bpy.ops.mesh.primitive_plane_add(size=200, location=(0, 0, min(low.z, 0.0)))
    material = bpy.data.materials.new("plain ground")
    material.use_nodes = True
    material.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (0.32, 0.31, 0.27, 1)
    material.node_tree.nodes["Principled BSDF"].inputs["Roughness"].default_value = 1.0
    bpy.context.object.data.materials.append(material)


def main():
    a = arguments()
    load(os.path.abspath(a.source))
    scene = bpy.context.scene
    if a.frame is not None:
        scene.frame_set(a.frame)
    show_maps(scene)
    bend_light()
    set_camera(scene, a)
    set_light(scene, a)
    if a.sky:
        set_sky(scene, a.sky)
    if a.through:
        shine_through(a.through)
    if a.plain:
        add_ground(scene)
    if a.haze:
        add_haze(scene, a.haze)
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.samples = a.samples
    scene.cycles.use_denoising = True
    scene.cycles.max_bounces = 8
    scene.view_settings.view_transform = "AgX"
    scene.view_settings.look = "AgX - Medium High Contrast"
    scene.view_settings.exposure = a.exposure
    scene.render.resolution_x, scene.render.resolution_y = (int(v) for v in a.size.split("x"))
    picture, ending = os.path.splitext(os.path.abspath(a.picture))
    for frame in range(a.frame, a.until + 1, a.every) if a.until else [None]:
        if frame is not None:
            scene.frame_set(frame)
        scene.render.filepath = picture + ending if frame is None else f"{picture}{frame:04}{ending}"
        bpy.ops.render.render(write_still=True)


main()
