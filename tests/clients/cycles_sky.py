"""What Cycles renders of a scene's sky: cycles_sky.py FILE.usda EXPECTED.json

Runs under bpy (5.0). Imports into the factory file, looks all around from above the plants and renders without a view transform.
EXPECTED: {"directions": [[x, y, z], ...]} in osier's space, above the horizon. Prints {"pixels": [[r, g, b], ...], "seconds"}.
"""
import json
import math
import os
import sys
import tempfile
import time

import bpy
from mathutils import Vector

path, wanted = sys.argv[-2:]
wanted = json.load(open(wanted, encoding="utf-8"))
bpy.ops.wm.read_factory_settings(use_empty=False)
for o in list(bpy.data.objects):
    bpy.data.objects.remove(o)
bpy.ops.wm.usd_import(filepath=path)

scene = bpy.context.scene
camera = bpy.data.objects.new("around", bpy.data.cameras.new("around"))
scene.collection.objects.link(camera)
scene.camera = camera
camera.location = (0.0, 0.0, 100.0)
camera.rotation_euler = (math.pi / 2, 0.0, 0.0)  # Looks along Blender's +Y, osier's -Z.
camera.data.type = "PANO"
camera.data.panorama_type = "EQUIRECTANGULAR"
scene.render.engine = "CYCLES"
scene.cycles.device = "CPU"
scene.cycles.samples = 1
scene.cycles.use_denoising = False
scene.cycles.pixel_filter_type = "BLACKMAN_HARRIS"
scene.cycles.filter_width = 0.01
width, height = 128, 64
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
print(json.dumps({"pixels": out, "seconds": seconds}))
