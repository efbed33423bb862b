# SPDX-License-Identifier: GPL-3.0-or-later
"""Imports bakes one after the other and compares what Blender has with their manifests: presets.py MANIFEST...

Runs under bpy 4.2 or newer. Prints `{"failed": [...], "counts": {scene: [placements, leaves]}}`. The expected values are read from the
JSON and the table of placements, not by the importer's own reader.
"""

import json
import math
import pathlib
import re
import struct
import sys
import traceback

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

import bpy
import osier_import
import script
from mathutils import Matrix

PLACE = struct.Struct("<10f")
"""A placement in the table: the index of its asset, its time, position, rotation and scale."""
TURN = Matrix(((1, 0, 0, 0), (0, 0, -1, 0), (0, 1, 0, 0), (0, 0, 0, 1)))
"""From axes with +Y up to Blender's."""


def placements(manifest: pathlib.Path, told: dict) -> list[str]:
    """The asset of each placement."""
    names = [asset["id"] for asset in told["assets"]]
    table = told["places"]
    if isinstance(table, str):
        return [names[int(row[0])] for row in PLACE.iter_unpack((manifest.parent / table).read_bytes())]
    return [name for name in names for _ in (table or {}).get(name, [])]


def check_counts(manifest: pathlib.Path, told: dict) -> tuple[int, int]:
    """Placements and leaves are those of the manifest. Returns both numbers."""
    name = told["scene"]["name"]
    parts = {o["osier_id"].removeprefix(f"{name}:"): o for o in bpy.data.objects if o.get("osier_id", "").startswith(f"{name}:")}
    shown = {asset["id"]: asset for asset in told["assets"] if asset.get("vertices") or asset.get("instances")}
    placed = [asset for asset in placements(manifest, told) if asset in shown]
    points = sum(len(o.data.vertices) for part, o in parts.items() if part.endswith("/copies"))
    alone = sum(re.sub(r"#\d+$", "", part) in shown for part in parts)
    assert points + alone == len(placed), (points, alone, len(placed))
    leaves = 0
    # Drops and catkins are points of tracks, whose number is that of a frame.
    for asset in sorted(a for a in set(placed) if shown[a]["kind"] == "plant"):
        # The first set of objects of an asset: copies of others, and at other times of the clip, share its data.
        clouds = {part: o for part, o in parts.items() if o.type == "POINTCLOUD" and re.split("[#@/]", part)[0] == asset}
        data = {o.data.as_pointer(): len(o.data.points) for o in clouds.values()}
        assert sum(data.values()) == shown[asset]["instances"], (asset, data, shown[asset]["instances"])
        leaves += shown[asset]["instances"]
    return len(placed), leaves


def check_view(told: dict) -> None:
    """Frame rate, range and camera are those of the manifest."""
    scene, time = bpy.context.scene, told["time"]
    rate = time["fps"][0] / time["fps"][1]
    assert math.isclose(scene.render.fps / scene.render.fps_base, rate, rel_tol=1e-6), (scene.render.fps, rate)
    assert [scene.frame_start, scene.frame_end] == time["written"], (scene.frame_start, scene.frame_end, time)
    entry, camera = told["view"]["camera"], scene.camera
    values = entry["matrix"]
    wanted = TURN @ Matrix([values[row::4] for row in range(4)])
    apart = max(abs(a - b) for x, y in zip(camera.matrix_basis, wanted, strict=True) for a, b in zip(x, y, strict=True))
    assert apart < 1e-5 * max(1.0, wanted.translation.length), (camera.matrix_basis, wanted)
    assert math.isclose(math.degrees(camera.data.angle_y), entry["vfov_deg"], rel_tol=1e-4), camera.data.angle_y


def main() -> None:
    osier_import.register()
    failed, counts = [], {}
    for manifest in map(pathlib.Path, sys.argv[1:]):
        told = json.loads(manifest.read_text())
        name = told["scene"]["name"]
        bpy.ops.wm.read_factory_settings()
        try:
            assert bpy.ops.import_scene.osier(filepath=str(manifest)) == {"FINISHED"}
            counts[name] = check_counts(manifest, told)
            check_view(told)
        except Exception:
            failed.append(f"{name}: {traceback.format_exc(limit=-2)}")
    print(json.dumps({"failed": failed, "counts": counts}))


script.run(main)
