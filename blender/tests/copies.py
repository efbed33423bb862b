# SPDX-License-Identifier: GPL-3.0-or-later
"""Compares copies of plants with what usd-core computes: copies.py MANIFEST EXPECTED.

Runs under bpy 4.2 or newer. EXPECTED is the output of `tests/clients/skinned_copies.py`. Prints the largest distance of a vertex of the
imported copies from its expected place, in metres, and how far the expected points move, as JSON.
"""

import json
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

import bpy
import numpy
import osier_import
import script


def in_scene(points: numpy.ndarray) -> numpy.ndarray:
    """Points of Blender in the axes of the scene, +Y up."""
    return numpy.stack([points[:, 0], points[:, 2], -points[:, 1]], 1)


def shown(places: numpy.ndarray) -> list[numpy.ndarray]:
    """Vertices of the copies that stand at the places, at the frame of the scene."""
    found: list[tuple[float, numpy.ndarray]] = [(1e-3, numpy.empty(0))] * len(places)
    for instance in bpy.context.evaluated_depsgraph_get().object_instances:
        item = instance.object
        if not instance.is_instance or item.type != "MESH" or not item.get("osier_id", "").endswith("/bark"):
            continue
        matrix = numpy.array(instance.matrix_world)
        away = numpy.linalg.norm(places - in_scene(matrix[None, :3, 3]), axis=1)
        nearest = int(away.argmin())
        if away[nearest] < found[nearest][0]:
            vertices = numpy.empty(3 * len(item.data.vertices), numpy.float32)
            item.data.vertices.foreach_get("co", vertices)
            points = vertices.reshape(-1, 3).astype(float) @ matrix[:3, :3].T + matrix[:3, 3]
            found[nearest] = (float(away[nearest]), in_scene(points))
    return [points for _, points in found]


def main() -> None:
    manifest, expected = sys.argv[1:]
    copies = json.loads(pathlib.Path(expected).read_text())
    bpy.ops.wm.read_factory_settings()
    osier_import.register()
    assert bpy.ops.import_scene.osier(filepath=manifest) == {"FINISHED"}
    places = numpy.array([copy["place"] for copy in copies])
    off, moved = 0.0, []
    frames = list(copies[0]["points"])
    for frame in frames:
        bpy.context.scene.frame_set(int(frame))
        for copy, points in zip(copies, shown(places), strict=True):
            wanted = numpy.array(copy["points"][frame])
            assert points.shape == wanted.shape, (copy["place"], frame, points.shape, wanted.shape)
            off = max(off, float(numpy.linalg.norm(points - wanted, axis=1).max()))
    for copy in copies:
        ends = [numpy.array(copy["points"][frame]) for frame in frames]
        moved.append(max(float(abs(end - ends[0]).max()) for end in ends))
    print(json.dumps({"off": off, "moved": moved}))


script.run(main)
