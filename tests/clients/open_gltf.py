"""How Blender opens a glTF file: open_gltf.py FILE.glb

Runs under bpy (5.0). Imports into the factory file and prints one JSON object: seconds, memory, objects, armatures, vertices that
the importer weighs one by one, and how far the bones of the first armature go within the clip.
"""
import json
import resource
import sys
import time

import bpy

bpy.ops.wm.read_factory_settings(use_empty=False)
start, used = time.time(), time.process_time()
assert bpy.ops.import_scene.gltf(filepath=sys.argv[-1]) == {"FINISHED"}
# On a machine that does other things too, the processor's time of all threads; on a quiet one, the time that passes.
seconds = min(time.time() - start, time.process_time() - used)

armatures = [o for o in bpy.data.objects if o.type == "ARMATURE"]
tails = []
for number in (0, 12, 36):
    bpy.context.scene.frame_set(number)
    # The last bones are the thinnest.
    tails.append([(armatures[0].matrix_world @ b.tail)[:] for b in armatures[0].pose.bones])
far = [max(sum((x - y) ** 2 for x, y in zip(p, q)) ** 0.5 for p, q in zip(tails[0], t)) for t in tails[1:]]
weighed = [o for o in bpy.data.objects if o.type == "MESH" and o.vertex_groups]
print(json.dumps({
    "seconds": seconds,
    "gigabytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6,
    "objects": len(bpy.data.objects),
    "armatures": len(armatures),
    "weighed": sum(len(o.data.vertices) for o in weighed),
    "moved": far,
}))
