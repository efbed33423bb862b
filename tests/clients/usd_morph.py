"""A moving cloud in Blender (bpy) or by usd-core (usd): usd_morph.py MODE BAKE SCENE CLOUD FPS

At three frames positions and colours equal those of the bake's PLY files, the extent holds them, and velocities are the
mean of the steps to the neighbouring frames; Blender's points are at the same places. Prints "3 frames".
"""
import glob
import os
import sys

import numpy as np

mode, bake, scene_name, cloud, fps = sys.argv[1:]
fps = float(fps)
paths = sorted(glob.glob(os.path.join(bake, "cloud", cloud + ".*.ply")))
first, last = 1, len(paths)
checked = [2, (first + last) // 2, last - 1]


def ply(frame):
    data = open(paths[frame - first], "rb").read()
    header, body = data.split(b"end_header\n", 1)
    kinds = {"float": "<f4", "uchar": "u1", "uint": "<u4"}
    rows = [l.split() for l in header.decode().splitlines() if l.startswith("property")]
    table = np.frombuffer(body, np.dtype([(name, kinds[kind]) for _, kind, name in rows]))
    return table, np.stack([table[n] for n in "xyz"], 1).astype(float)


def told(what, got, want, tolerance):
    assert got.shape == want.shape, (what, got.shape, want.shape)
    worst = np.abs(got - want).max()
    assert worst <= tolerance, (what, worst)


def srgb(linear):
    linear = np.asarray(linear, dtype=float)
    return np.where(linear <= 0.0031308, linear * 12.92, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)


def by_usd():
    from pxr import Usd, UsdGeom

    stage = Usd.Stage.Open(os.path.join(bake, scene_name + ".usda"))
    found = [p for p in stage.Traverse() if p.IsA(UsdGeom.Points)]
    assert len(found) == 1, found
    points = UsdGeom.Points(found[0])
    for attr in (points.GetPointsAttr(), points.GetVelocitiesAttr(), points.GetExtentAttr()):
        assert attr.GetTimeSamples() == list(range(first, last + 1)), attr
    for frame in checked:
        table, want = ply(frame)
        got = np.array(points.GetPointsAttr().Get(frame), dtype=float)
        told("points", got, want, 1e-7)
        low, high = np.array(points.GetExtentAttr().Get(frame), dtype=float)
        radius = np.array(points.GetWidthsAttr().Get(frame), dtype=float)[:, None] / 2
        assert (got - radius >= low - 1e-5).all() and (got + radius <= high + 1e-5).all()
        color = srgb(points.GetDisplayColorPrimvar().Get(frame)) * 255
        told("colours", color, np.stack([table[n] for n in ("red", "green", "blue")], 1).astype(float), 0.51)
        # Velocities are means over the frame around it; steps of two frames bend a little more.
        speed = np.array(points.GetVelocitiesAttr().Get(frame), dtype=float)
        steps = (ply(frame + 1)[1] - ply(frame - 1)[1]) * fps / 2
        assert np.abs(speed - steps).mean() <= 0.06 * np.abs(steps).mean() + 1e-6, (frame, np.abs(speed - steps).mean())
        # Blurred over a frame's half, points come where the next frame and this one have their middle.
        half = got + speed / fps / 2
        told("middles", half, (got + ply(frame + 1)[1]) / 2, 0.03)
    return len(checked)


def by_blender():
    import bpy

    bpy.ops.wm.read_factory_settings(use_empty=True)
    assert bpy.ops.wm.usd_import(filepath=os.path.join(bake, scene_name + ".usda")) == {"FINISHED"}
    scene = bpy.context.scene
    assert (scene.frame_start, scene.frame_end) == (first, last)
    clouds = [o for o in bpy.data.objects if o.type == "POINTCLOUD"]
    assert len(clouds) == 1, list(bpy.data.objects)
    for frame in checked:
        scene.frame_set(frame)
        held = clouds[0].evaluated_get(bpy.context.evaluated_depsgraph_get())

        def vectors(name):
            values = held.data.attributes[name].data
            out = np.zeros(len(values) * 3, dtype=np.float32)
            values.foreach_get("vector", out)
            return out.reshape(-1, 3).astype(float)

        m = np.array(held.matrix_world)
        placed = vectors("position") @ m[:3, :3].T + m[:3, 3]
        told("points", np.stack([placed[:, 0], placed[:, 2], -placed[:, 1]], 1), ply(frame)[1], 1e-5)
        if "velocity" in held.data.attributes:
            speed = vectors("velocity") @ m[:3, :3].T
            speed = np.stack([speed[:, 0], speed[:, 2], -speed[:, 1]], 1)
            steps = (ply(frame + 1)[1] - ply(frame - 1)[1]) / 2
            # Blender keeps velocities per frame or per second, as its version has it.
            nearest = min(np.abs(speed * k - steps).mean() for k in (1.0, 1.0 / fps))
            assert nearest <= 0.06 * np.abs(steps).mean() + 1e-6, (frame, nearest)
            print("velocities", frame)
    return len(checked)


print((by_usd if mode == "usd" else by_blender)(), "frames")
