# SPDX-License-Identifier: GPL-3.0-or-later
"""Places assets: few as objects, many as points of a mesh with Geometry Nodes; at their times of the clip."""

import bpy
from mathutils import Matrix, Quaternion, Vector

from .manifest import Bake, Place
from .world import TURN, matrix

GROUP = "osier copies"
"""Name of the node group that shows copies at the points of a mesh."""


def blender_matrix(place: Place) -> Matrix:
    """A placement in Blender's axes, for objects whose own matrix already turns the axes."""
    return TURN @ matrix(place.matrix) @ TURN.inverted()


def hierarchy(root: bpy.types.Object) -> list[bpy.types.Object]:
    """An object and all objects below it, parents first."""
    return [root, *root.children_recursive]


def duplicate(root: bpy.types.Object) -> list[bpy.types.Object]:
    """A copy of an object and all below it, with the same data; the copies are in no collection."""
    copied: dict[bpy.types.Object, bpy.types.Object] = {}
    for source in hierarchy(root):
        copy = source.copy()
        copied[source] = copy
        if source is not root and source.parent in copied:
            copy.parent = copied[source.parent]
            copy.matrix_parent_inverse = source.matrix_parent_inverse
    for copy in copied.values():
        for modifier in copy.modifiers:
            if modifier.type == "ARMATURE" and modifier.object in copied:
                modifier.object = copied[modifier.object]
    return list(copied.values())


def shift(objects: list[bpy.types.Object], bake: Bake, offset: float, caches: dict) -> None:
    """Shows objects `offset` frames ahead of the clip, which repeats. `caches`: copies of cache files by file and offset."""
    span = bake.span()
    ahead = offset % span
    if ahead == 0:
        return
    for item in objects:
        data = item.animation_data
        if data and data.action:
            action, slot = data.action, getattr(data, "action_slot", None)
            track = data.nla_tracks.new()
            track.name = "osier clip"
            strip = track.strips.new(f"osier +{ahead:g}", bake.start, action)
            if slot:
                strip.action_slot = slot
            strip.action_frame_start = bake.start
            strip.action_frame_end = bake.start + span
            strip.repeat = 3.0
            # Setting the start moves the end, too, except that the end may not come before the start.
            strip.frame_start = bake.start - ahead
            strip.frame_end = bake.start - ahead + 3 * span
            data.action = None
        for user in cache_users(item):
            if user.cache_file:
                key = (user.cache_file, ahead)
                if key not in caches:
                    caches[key] = user.cache_file.copy()
                    caches[key].frame_offset -= ahead
                path = user.object_path
                user.cache_file = caches[key]
                user.object_path = path


def cache_users(item: bpy.types.Object) -> list:
    """Modifiers and constraints that read a cache file."""
    return [m for m in item.modifiers if m.type == "MESH_SEQUENCE_CACHE"] + [
        c for c in item.constraints if c.type == "TRANSFORM_CACHE"
    ]


def is_many(places: list[Place]) -> bool:
    """Whether placements of a kind of plant become points instead of objects."""
    return len(places) > max(8, 2 * len({p.asset for p in places}))


def scatter(name: str, places: list[Place], prototypes: list[bpy.types.Collection], numbers: list[int]) -> bpy.types.Object:
    """A mesh whose points show `prototypes`. `numbers`: index of the prototype of each placement."""
    mesh = bpy.data.meshes.new(f"{name} copies")
    count = len(places)
    mesh.vertices.add(count)
    positions, turns, scales = [], [], []
    for place in places:
        position, turn, scale = blender_matrix(place).decompose()
        positions.extend(position)
        turns.extend(_turn(turn))
        scales.extend(scale)
    mesh.vertices.foreach_set("co", positions)
    mesh.attributes.new("proto", "INT", "POINT").data.foreach_set("value", numbers)
    if has_quaternions():
        mesh.attributes.new("turn", "QUATERNION", "POINT").data.foreach_set("value", turns)
    else:
        mesh.attributes.new("turn", "FLOAT_VECTOR", "POINT").data.foreach_set("vector", turns)
    mesh.attributes.new("scale", "FLOAT_VECTOR", "POINT").data.foreach_set("vector", scales)
    mesh.update()
    shown = bpy.data.objects.new(mesh.name, mesh)
    parent = bpy.data.collections.new(f"{name} copied")
    for prototype in prototypes:
        parent.children.link(prototype)
    modifier = shown.modifiers.new("osier copies", "NODES")
    modifier.node_group = node_group()
    modifier[collection_input(modifier.node_group)] = parent
    return shown


def has_quaternions() -> bool:
    """Whether attributes can hold rotations; else they are Euler angles."""
    return bpy.app.version >= (4, 0, 0)


def _turn(turn: Quaternion) -> Quaternion | Vector:
    return turn if has_quaternions() else Vector(turn.to_euler())


def collection_input(group: bpy.types.NodeTree) -> str:
    """Identifier of the input of `node_group` that takes the prototypes."""
    if hasattr(group, "interface"):
        items = [i for i in group.interface.items_tree if i.item_type == "SOCKET" and i.in_out == "INPUT"]
        return next(i.identifier for i in items if i.name == "Prototypes")
    return next(i.identifier for i in group.inputs if i.name == "Prototypes")


def node_group() -> bpy.types.NodeTree:
    """The node group of copies; there is one in a file."""
    found = bpy.data.node_groups.get(GROUP)
    if found and found.get("osier_id") == GROUP:
        return found
    group = bpy.data.node_groups.new(GROUP, "GeometryNodeTree")
    group["osier_id"] = GROUP
    if hasattr(group, "interface"):
        group.interface.new_socket("Points", in_out="INPUT", socket_type="NodeSocketGeometry")
        group.interface.new_socket("Prototypes", in_out="INPUT", socket_type="NodeSocketCollection")
        group.interface.new_socket("Copies", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    else:
        group.inputs.new("NodeSocketGeometry", "Points")
        group.inputs.new("NodeSocketCollection", "Prototypes")
        group.outputs.new("NodeSocketGeometry", "Copies")
    nodes, links = group.nodes, group.links
    source, target = nodes.new("NodeGroupInput"), nodes.new("NodeGroupOutput")
    info, show = nodes.new("GeometryNodeCollectionInfo"), nodes.new("GeometryNodeInstanceOnPoints")
    _location(source, -600, 100), _location(info, -300, 0), _location(show, 0, 100), _location(target, 250, 100)
    info.inputs["Separate Children"].default_value = True
    info.inputs["Reset Children"].default_value = True
    show.inputs["Pick Instance"].default_value = True
    links.new(source.outputs["Points"], show.inputs["Points"])
    links.new(source.outputs["Prototypes"], info.inputs["Collection"])
    links.new(next(o for o in info.outputs if o.type == "GEOMETRY"), show.inputs["Instance"])
    rotation = "QUATERNION" if has_quaternions() else "FLOAT_VECTOR"
    wanted = (("proto", "INT", "Instance Index"), ("turn", rotation, "Rotation"), ("scale", "FLOAT_VECTOR", "Scale"))
    for i, (attribute, kind, input_name) in enumerate(wanted):
        named = nodes.new("GeometryNodeInputNamedAttribute")
        _location(named, -300, -200 - 150 * i)
        named.data_type = kind
        named.inputs["Name"].default_value = attribute
        links.new(next(o for o in named.outputs if o.enabled and o.name == "Attribute"), show.inputs[input_name])
    links.new(show.outputs["Instances"], target.inputs["Copies"])
    return group


def _location(node: bpy.types.Node, x: float, y: float) -> None:
    node.location = (x, y)
