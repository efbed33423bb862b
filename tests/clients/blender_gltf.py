"""Imports glTF files into Blender and compares what is evaluated with what osier expects.

Runs under bpy (5.0) and under Blender 3.4 headless. Last argument: a JSON file with a list of jobs:
  {"file": .glb, "fps": 24, "start": 1, "absent": [names],
   "frames": {"1": {name: {"points": [[x,y,z], ...], "pairs": false, "hidden": false}}},
   "cache": {"object": name, "pc2": path} or null}
Space of the points is osier's: right-handed, +Y up, metres. "pairs": the expected points lie halfway between
successive vertices (ribbons). "hidden": all vertices fall into one point.
Prints the largest distance of each job; ends with an error beyond 1e-4 m, or beyond "bound" of the job.
"""
import json
import math
import sys

import numpy

if not hasattr(numpy, "bool"):
    # The importer of Blender 3.4 uses the alias that numpy 1.24 dropped.
    numpy.bool = bool

import bpy  # noqa: E402

TOLERANCE = 1e-4


def evaluated(name):
    """World positions of an object's vertices in osier's space, n x 3."""
    graph = bpy.context.evaluated_depsgraph_get()
    source = bpy.data.objects[name].evaluated_get(graph)
    mesh = source.to_mesh()
    local = numpy.empty(3 * len(mesh.vertices), numpy.float32)
    mesh.vertices.foreach_get("co", local)
    source.to_mesh_clear()
    world = numpy.array(source.matrix_world)
    points = local.reshape(-1, 3) @ world[:3, :3].T + world[:3, 3]
    return numpy.stack([points[:, 0], points[:, 2], -points[:, 1]], axis=1)


def check(name, want, where, bound):
    got = evaluated(name)
    if want.get("hidden"):
        spread = float(numpy.ptp(got, axis=0).max())
        assert spread < TOLERANCE, f"{where}: {name} is dead but spans {spread} m"
        return 0.0
    if want.get("pairs"):
        got = (got[0::2] + got[1::2]) / 2
    expected = numpy.array(want["points"], numpy.float64).reshape(-1, 3)
    assert got.shape == expected.shape, f"{where}: {name} has {len(got)} vertices, not {len(expected)}"
    error = float(numpy.abs(got - expected).max())
    assert error < bound, f"{where}: {name} is off by {error} m\n got {got[:3]}\nwant {expected[:3]}"
    return error


def run(job):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.fps = round(job["fps"])
    bpy.ops.import_scene.gltf(filepath=job["file"])
    for name in job.get("absent", []):
        assert name not in bpy.data.objects, f"{name} is not meant to be here"
    shift = job["start"]
    if job.get("cache"):
        target = bpy.data.objects[job["cache"]["object"]]
        modifier = target.modifiers.new("cache", "MESH_CACHE")
        modifier.cache_format = "PC2"
        modifier.filepath = job["cache"]["pc2"]
        modifier.frame_start = job["start"]
        shift = 0  # the cache knows frame numbers, glTF only seconds from the first
    worst = 0.0
    for number, objects in job["frames"].items():
        frame = float(number) - shift
        scene.frame_set(math.floor(frame), subframe=frame - math.floor(frame))
        for name, want in objects.items():
            worst = max(worst, check(name, want, f"{job['file']}, frame {number}", job.get("bound", TOLERANCE)))
    if camera := job.get("camera"):
        place = bpy.data.objects["camera"].matrix_world
        eye, forward = place.translation, -place.col[2].xyz
        to_ours = lambda v: (v[0], v[2], -v[1])
        for got, want in ((to_ours(eye), camera["eye"]), (to_ours(forward), camera["forward"])):
            assert all(abs(a - b) < TOLERANCE for a, b in zip(got, want)), f"camera: {got} not {want}"
        got = bpy.data.cameras[0].angle_y
        assert abs(got - camera["vfov"]) < 1e-4, f"camera: vertical angle {got}"
    meshes = len([o for o in bpy.data.objects if o.type == "MESH"])
    print(json.dumps({"file": job["file"], "worst": worst, "meshes": meshes}), flush=True)


for each in json.load(open(sys.argv[-1], encoding="utf-8")):
    run(each)
