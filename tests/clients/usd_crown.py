"""How Blender holds the leaves of a crown, and that Cycles renders them: usd_crown.py STAGE

Prints "crown INSTANCES MESHES CUT": instances of leaves, the meshes they share, and 1 if the leaves' material is cut by its
picture's alpha.
"""
import os
import sys
import tempfile

import bpy

bpy.ops.wm.read_factory_settings(use_empty=True)
assert bpy.ops.wm.usd_import(filepath=sys.argv[1], import_usd_preview=True) == {"FINISHED"}
graph = bpy.context.evaluated_depsgraph_get()
count, meshes, materials = 0, set(), set()
for i in graph.object_instances:
    if i.is_instance and i.object.type == "MESH":
        count += 1
        meshes.add(i.object.data.name)
        materials.update(m.name for m in i.object.data.materials if m)
cut = 0
for name in materials:
    nodes = bpy.data.materials[name].node_tree.nodes
    shader = next(n for n in nodes if n.type == "BSDF_PRINCIPLED")
    cut |= int(shader.inputs["Alpha"].is_linked)

scene = bpy.context.scene
camera = bpy.data.objects.new("view", bpy.data.cameras.new("view"))
camera.location, camera.rotation_euler = (0, -16, 3), (1.57, 0, 0)
scene.collection.objects.link(camera)
scene.camera = camera
scene.render.engine = "CYCLES"
scene.cycles.samples = 1
scene.render.resolution_x = scene.render.resolution_y = 64
scene.world = bpy.data.worlds.new("sky")
with tempfile.TemporaryDirectory() as folder:
    scene.render.filepath = os.path.join(folder, "x.png")
    bpy.ops.render.render(write_still=True)
    picture = bpy.data.images.load(scene.render.filepath)
    shades = {round(v, 2) for v in picture.pixels[:][0::4]}
    assert len(shades) > 4, "the crown is in the picture"
print("crown", count, len(meshes), cut)
