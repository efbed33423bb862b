"""Which pictures drive Blender's materials: materials.py FILE.usda

Runs under bpy (5.0). Prints one JSON object: for each material, by the name of a socket of its Principled BSDF, the file of the
picture that drives it, or its number.
"""
import json
import os
import sys

import bpy

SOCKETS = ("Base Color", "Roughness", "Normal", "Coat Weight", "Coat Roughness", "IOR", "Alpha")


def picture(socket):
    """File of the first picture upstream of a linked socket."""
    todo = [link.from_node for link in socket.links]
    while todo:
        node = todo.pop()
        if node.type == "TEX_IMAGE" and node.image:
            return os.path.basename(bpy.path.abspath(node.image.filepath))
        todo += [link.from_node for s in node.inputs for link in s.links]
    return None


bpy.ops.wm.read_factory_settings(use_empty=True)
assert bpy.ops.wm.usd_import(filepath=sys.argv[-1]) == {"FINISHED"}
out = {}
for material in bpy.data.materials:
    for node in material.node_tree.nodes:
        if node.type == "BSDF_PRINCIPLED":
            sockets = {s.name: s for s in node.inputs if s.name in SOCKETS}
            plain = {k: s.default_value for k, s in sockets.items() if not s.is_linked and isinstance(s.default_value, float)}
            out[material.name] = plain | {k: picture(s) for k, s in sockets.items() if s.is_linked}
print(json.dumps(out))
