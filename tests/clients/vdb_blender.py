"""What Blender reads of a voxel grid: vdb_blender.py FILE GRID KIND CELLS PLACES

KIND is FLOAT or VECTOR; CELLS and PLACES are JSON lists of three numbers, cells by index and points in metres in the axes of the
file. Prints one line of JSON: the values at the cells (node Sample Grid Index) and at the points (node Sample Grid, nearest).
"""
import json
import sys

import bpy
import numpy as np

path, name, kind = sys.argv[1:4]
cells, places = json.loads(sys.argv[4]), json.loads(sys.argv[5])
bpy.ops.wm.read_factory_settings(use_empty=True)
volume = bpy.data.volumes.new("volume")
volume.filepath = path
assert volume.grids.load(), volume.grids.error_message
source = bpy.data.objects.new("volume", volume)
bpy.context.scene.collection.objects.link(source)


def sample(points, by_index):
    """Values of the grid at the vertices of a mesh."""
    tree = bpy.data.node_groups.new("sample", "GeometryNodeTree")
    for way in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    node, link = (lambda k: tree.nodes.new(k)), tree.links.new
    info, grid = node("GeometryNodeObjectInfo"), node("GeometryNodeGetNamedGrid")
    info.inputs["Object"].default_value = source
    grid.data_type = kind
    grid.inputs["Name"].default_value = name
    link(info.outputs["Geometry"], grid.inputs["Volume"])
    at = node("GeometryNodeInputPosition")
    if by_index:
        read, split = node("GeometryNodeSampleGridIndex"), node("ShaderNodeSeparateXYZ")
        read.data_type = kind
        link(at.outputs[0], split.inputs[0])
        for axis in "XYZ":
            link(split.outputs[axis], read.inputs[axis])
    else:
        read = node("GeometryNodeSampleGrid")
        read.data_type = kind
        # A property of the node in Blender 4.5, an input in 5.0.
        if hasattr(read, "interpolation_mode"):
            read.interpolation_mode = "NEAREST"
        else:
            read.inputs["Interpolation"].default_value = "Nearest Neighbor"
        link(at.outputs[0], read.inputs["Position"])
    link(grid.outputs["Grid"], read.inputs["Grid"])
    store = node("GeometryNodeStoreNamedAttribute")
    store.data_type = "FLOAT_VECTOR" if kind == "VECTOR" else "FLOAT"
    store.inputs["Name"].default_value = "found"
    link(node("NodeGroupInput").outputs["Geometry"], store.inputs["Geometry"])
    link(read.outputs["Value"], store.inputs["Value"])
    link(store.outputs["Geometry"], node("NodeGroupOutput").inputs["Geometry"])
    mesh = bpy.data.meshes.new("points")
    mesh.from_pydata(points, [], [])
    holder = bpy.data.objects.new("points", mesh)
    bpy.context.scene.collection.objects.link(holder)
    holder.modifiers.new("sample", "NODES").node_group = tree
    now = holder.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
    data = now.attributes["found"].data
    width = 3 if kind == "VECTOR" else 1
    out = np.zeros(len(data) * width, np.float32)
    data.foreach_get("vector" if kind == "VECTOR" else "value", out)
    return out.reshape(-1, width).tolist()


print(json.dumps({"cells": sample(cells, True), "places": sample(places, False)}))
