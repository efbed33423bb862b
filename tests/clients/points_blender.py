"""What Blender's node Import CSV makes of a table of points: points_blender.py FOLDER TABLE FRAME...

FOLDER holds points/. A file is saved beside it with the nodes that docs/formats.md describes. Prints one line of JSON: per frame
the number of points, the type of every attribute, the values of `id` and the positions.
"""
import json
import os
import sys
import time

import bpy
import numpy as np

folder, table, frames = sys.argv[1], sys.argv[2], [int(n) for n in sys.argv[3:]]
bpy.ops.wm.read_factory_settings(use_empty=True)
tree = bpy.data.node_groups.new("points", "GeometryNodeTree")
tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
node = lambda kind: tree.nodes.new(kind)
link = tree.links.new

clock, path, read = node("GeometryNodeInputSceneTime"), node("FunctionNodeFormatString"), node("GeometryNodeImportCSV")
path.format_items.new("FLOAT", "frame")
path.inputs["Format"].default_value = f"//points/{table}_{{:04}}.csv"
link(clock.outputs["Frame"], path.inputs["frame"])
link(path.outputs[0], read.inputs["Path"])
axes, place = node("ShaderNodeCombineXYZ"), node("GeometryNodeSetPosition")
for name in "xyz":
    value = node("GeometryNodeInputNamedAttribute")
    value.data_type = "FLOAT"
    value.inputs["Name"].default_value = name
    link(value.outputs["Attribute"], axes.inputs[name.upper()])
link(read.outputs[0], place.inputs["Geometry"])
link(axes.outputs[0], place.inputs["Position"])
link(place.outputs[0], node("NodeGroupOutput").inputs["Geometry"])

holder = bpy.data.objects.new("points", bpy.data.meshes.new("points"))
bpy.context.scene.collection.objects.link(holder)
holder.modifiers.new("points", "NODES").node_group = tree
# Paths that begin with // are relative to the saved file.
bpy.ops.wm.save_as_mainfile(filepath=os.path.join(os.path.abspath(folder), "points.blend"))


def at(frame):
    start = time.perf_counter()
    bpy.context.scene.frame_set(frame)
    # The set owns its point cloud: it must outlive the reading.
    geometry = holder.evaluated_get(bpy.context.evaluated_depsgraph_get()).evaluated_geometry()
    cloud = geometry.pointcloud
    seconds = time.perf_counter() - start
    if cloud is None:
        return None
    count = len(cloud.points)
    kinds = {a.name: a.data_type for a in cloud.attributes}
    ids, places = np.zeros(count, np.int32), np.zeros(count * 3, np.float32)
    if "id" in kinds:
        cloud.attributes["id"].data.foreach_get("value", ids)
    if count:
        cloud.attributes["position"].data.foreach_get("vector", places)
    return {"count": count, "types": kinds, "ids": ids.tolist(), "positions": places.tolist(), "seconds": seconds}


print(json.dumps({frame: at(frame) for frame in frames}))
