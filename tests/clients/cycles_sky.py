"""What Cycles renders of a scene's sky: cycles_sky.py FILE EXPECTED.json

Runs under bpy (4.2 or newer). FILE is the stage of a bake, which Blender's own importer reads into the factory file, or its manifest, which
the extension in `blender/` imports. Then only the sky is kept: the script looks all around and renders without a view transform.
EXPECTED: {"directions": [[x, y, z], ...]} in osier's space, above the horizon. Prints {"pixels": [[r, g, b], ...], "seconds"}.
"""
import json
import math
import os
import pathlib
import sys
import tempfile
import time

import bpy
from mathutils import Vector

path, wanted = sys.argv[-2:]
wanted = json.load(open(wanted, encoding="utf-8"))
bpy.ops.wm.read_factory_settings(use_empty=False)
if path.endswith(".json"):
    sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "blender"))
    import osier_import

    osier_import.register()
    assert bpy.ops.import_scene.osier(filepath=path) == {"FINISHED"}
else:
    bpy.ops.wm.usd_import(filepath=path)
for o in list(bpy.data.objects):
    bpy.data.objects.remove(o)

scene = bpy.context.scene
camera = bpy.data.objects.new("around", bpy.data.cameras.new("around"))
scene.collection.objects.link(camera)
scene.camera = camera
camera.rotation_euler = (math.pi / 2, 0.0, 0.0)  # Looks along Blender's +Y, osier's -Z.
camera.data.type = "PANO"
camera.data.panorama_type = "EQUIRECTANGULAR"
scene.render.engine = "CYCLES"
scene.cycles.device = "CPU"
scene.cycles.samples = 1
scene.cycles.use_denoising = False
scene.cycles.pixel_filter_type = "BLACKMAN_HARRIS"
scene.cycles.filter_width = 0.01
width, height = 512, 256
scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = width, height, 100
scene.render.image_settings.file_format = "OPEN_EXR"
scene.render.image_settings.color_depth = "32"
scene.view_settings.view_transform = "Raw"
scene.render.filepath = os.path.join(tempfile.mkdtemp(), "sky.exr")
start = time.time()
bpy.ops.render.render(write_still=True)
seconds = time.time() - start

image = bpy.data.images.load(scene.render.filepath)
pixels = image.pixels[:]
out = []
for x, y, z in wanted["directions"]:
    d = Vector((x, y, z)).normalized()
    u = 0.5 + math.atan2(d.x, -d.z) / (2 * math.pi)
    v = 0.5 + math.asin(d.y) / math.pi
    at = 4 * (min(int(v * height), height - 1) * width + min(int(u * width), width - 1))
    out.append(list(pixels[at:at + 3]))
print(json.dumps({"pixels": out, "seconds": seconds}), flush=True)
# Blender 4.5 as a module may not end by itself while an add-on is registered.
os._exit(0)
