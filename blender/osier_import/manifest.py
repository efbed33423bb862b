# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads and checks the manifest of a bake. Does not need Blender."""

import json
import math
import os
import re
import struct
import sys
from array import array
from dataclasses import dataclass, field
from typing import Any

SCHEMA = 1
"""Newest schema of manifests that this module reads."""

LEAF_BYTES = 16
"""Bytes of one leaf in a table: four 32-bit floats."""

PLACE_BYTES = 40
"""Bytes of one placement in a table: ten 32-bit floats."""

Matrix = tuple[float, ...]
"""16 numbers for row vectors: the images of x, y and z, then the position."""


class BakeError(Exception):
    """A bake that cannot be imported: the message has path, cause and next step."""

    def __init__(self, path: str, cause: str, step: str) -> None:
        super().__init__(f"{path}: {cause}. {step}")


@dataclass(frozen=True)
class Place:
    """Where and at which time of the clip an asset is shown."""

    asset: str
    matrix: Matrix
    offset: float


@dataclass(frozen=True)
class Leaves:
    """Colour and occlusion of an asset's leaves: a table with four 32-bit floats for each instance, instancer after instancer."""

    file: str
    counts: list[tuple[str, int]]
    color: bool
    occlusion: bool


@dataclass(frozen=True)
class Asset:
    """A plant, terrain or other part that the stage contains once."""

    name: str
    prim: str
    group: str
    points_material: str | None
    has_geometry: bool
    leaves: Leaves | None = None
    curve_materials: dict[str, str] = field(default_factory=dict)
    is_plant: bool = False
    is_land: bool = False


@dataclass(frozen=True)
class Sequence:
    """Numbered pictures: `pattern` has `####` in place of the frame; `frames` are the written ones, rising."""

    pattern: str
    digits: int
    frames: tuple[int, ...]

    @property
    def first(self) -> int:
        """The first written frame."""
        return self.frames[0]

    @property
    def last(self) -> int:
        """The last written frame."""
        return self.frames[-1]

    def path(self, frame: int) -> str:
        """The file of a frame."""
        return self.pattern.replace("####", str(frame).zfill(self.digits))


@dataclass(frozen=True)
class Bake:
    """A checked manifest. Paths are absolute; numbers are in the scene's axes, +Y up."""

    path: str
    folder: str
    scene: str
    bake_hash: str
    fps: tuple[int, int]
    first: int
    last: int
    start: int
    step: int
    loop: int | None
    stage: str
    has_assets_stage: bool
    assets: list[Asset]
    places: list[Place]
    materials: list[dict[str, Any]]
    sequences: dict[str, Sequence]
    view: dict[str, Any]
    wet_albedo: float
    wet_roughness: float
    notes: list[str] = field(default_factory=list)

    def file(self, relative: str) -> str:
        """The absolute path of a file of the bake."""
        return os.path.join(self.folder, *relative.split("/"))

    def leaf_rows(self, asset: Asset) -> dict[str, array]:
        """Four numbers for each leaf of an asset, by instancer: linear red, green and blue, occlusion. Empty without leaves."""
        if asset.leaves is None:
            return {}
        with open(self.file(asset.leaves.file), "rb") as file:
            content = file.read()
        if len(content) != LEAF_BYTES * sum(count for _, count in asset.leaves.counts):
            raise BakeError(self.path, f"{asset.leaves.file} has not the size that the manifest says", "Bake again into a new folder")
        rows, start = {}, 0
        for name, count in asset.leaves.counts:
            values = array("f")
            values.frombytes(content[start : start + LEAF_BYTES * count])
            if sys.byteorder == "big":
                values.byteswap()
            rows[name] = values
            start += LEAF_BYTES * count
        return rows

    def is_occluded(self) -> bool:
        """Whether leaves have the occlusion of their crown."""
        return any(a.leaves and a.leaves.occlusion for a in self.assets)

    def span(self) -> int:
        """Frames after which the motion repeats."""
        return self.loop or (self.last - self.start + 1)


def read(path: str) -> Bake:
    """Reads the manifest at `path`, or in the folder `path`, and checks every file that the import needs.

    Raises `BakeError`.
    """
    path = os.path.abspath(path)
    if os.path.isdir(path):
        path = os.path.join(path, "manifest.json")
    if not os.path.isfile(path):
        raise BakeError(path, "there is no such file: the bake is not complete", "Bake again and choose its manifest.json")
    try:
        with open(path, encoding="utf-8") as file:
            data = json.load(file)
    except (OSError, ValueError, RecursionError) as error:
        raise BakeError(path, f"this is not a JSON file that can be read ({error})", "Choose the manifest.json of a bake") from error
    if not isinstance(data, dict) or data.get("generator") != "osier":
        raise BakeError(path, "this file is not a manifest of osier", "Choose the manifest.json of a bake")
    schema = data.get("schema")
    if not isinstance(schema, int) or isinstance(schema, bool) or schema < 1:
        raise BakeError(path, "the manifest is damaged: it has no number as its schema", "Bake again into a new folder")
    if schema > SCHEMA:
        raise BakeError(path, f"schema {schema} is newer than {SCHEMA}", "Update the extension")
    try:
        return _bake(path, data)
    except BakeError:
        raise
    except (AttributeError, IndexError, KeyError, TypeError, ValueError, ZeroDivisionError, struct.error, OSError) as error:
        cause = f"the manifest is damaged ({type(error).__name__}: {error})"
        raise BakeError(path, cause, "Bake again into a new folder") from error


def _bake(path: str, data: dict[str, Any]) -> Bake:
    folder = os.path.dirname(path)
    time, units, view, notes = data["time"], data.get("units") or {}, data.get("view") or {}, []
    fps = (int(time["fps"][0]), int(time["fps"][1]))
    if fps[0] <= 0 or fps[1] <= 0:
        raise ValueError(f"frame rate {fps[0]}/{fps[1]}")
    sequences = _sequences(data)
    first, last = _written(time, sequences)
    stage = _stage(path, data, notes)
    assets = [_asset(a) for a in data["assets"]]
    needed = [stage] + [f for a in data["assets"] for f in a.get("files", []) if f.startswith("usd/")]
    needed += [a.leaves.file for a in assets if a.leaves]
    table = data.get("places")
    if isinstance(table, str):
        needed.append(table)
    for material in data["materials"]:
        needed += [slot for slot in material["slots"].values() if slot]
        for name in ("wetness", "normal"):
            file = material["maps"].get(name)
            if file:
                needed += [sequences[file].path(frame) for frame in sequences[file].frames] if file in sequences else [str(file)]
    _check_files(path, folder, needed)
    if not view:
        notes.append("the manifest has no camera and light: bake again with a newer osier")
    if any(m["class"] == "leaf" and m.get("leaf_ids") and not m["maps"].get("wetness") for m in data["materials"]):
        notes.append("the leaves are dry, since the bake has no maps of their water: bake with --formats usd,exr")
    return Bake(
        path=path,
        folder=folder,
        scene=str(data["scene"]["name"]),
        bake_hash=str(data["bake_hash"]),
        fps=fps,
        first=first,
        last=last,
        start=int(time["start"]),
        step=max(int(time.get("step") or 1), 1),
        loop=time.get("loop"),
        stage=os.path.join(folder, *stage.split("/")),
        has_assets_stage=bool(data.get("stage")),
        assets=assets,
        places=_places(folder, table, assets),
        materials=[_material(m) for m in data["materials"]],
        sequences=sequences,
        view=_view(view),
        wet_albedo=float(units.get("wet_albedo", 0.55)),
        wet_roughness=float(units.get("wet_roughness", 0.08)),
        notes=notes,
    )


def _stage(path: str, data: dict[str, Any], notes: list[str]) -> str:
    """The stage to import. Bakes of older versions have only the scene's own stage, with placements, camera and sun."""
    if data.get("stage"):
        return str(data["stage"])
    names = [f["path"] for f in data["files"]]
    own = f"{data['scene']['name']}.usda"
    if "stage" in data or own not in names:
        raise BakeError(path, "the bake has no USD", "Bake with --formats usd")
    notes.append("an older osier baked this folder: placements are those of its USD file")
    return own


def _asset(entry: dict[str, Any]) -> Asset:
    name = str(entry["id"])
    # Older manifests do not name the kind of plant: individuals are numbered.
    group = entry.get("plant") or (name if "plant" in entry else re.sub(r"_\d+$", "", name))
    geometry = bool(entry.get("vertices") or entry.get("instances"))
    prim = str(entry.get("prim") or name).rsplit("/", 1)[-1]
    curves = {str(curve): str(material) for curve, material in entry.get("curve_materials", {}).items()}
    return Asset(name, prim, str(group), entry.get("points_material"), geometry, _leaves(entry.get("leaves")), curves, bool(entry.get("plant")), entry.get("kind") == "terrain")


def _leaves(entry: dict[str, Any] | None) -> Leaves | None:
    if not entry:
        return None
    counts = [(str(name), int(entry["instancers"][name])) for name in entry["order"]]
    if any(count < 0 for _, count in counts):
        raise ValueError("a negative number of leaves")
    return Leaves(str(entry["file"]), counts, bool(entry.get("color")), bool(entry.get("occlusion")))


def _sequences(data: dict[str, Any]) -> dict[str, Sequence]:
    digits = int(data["time"].get("digits", 4))
    found = {}
    for entry in data["files"]:
        frames = entry.get("frames")
        if frames and "####" in entry["path"]:
            written = sorted(int(item["frame"]) for item in entry["items"])
            found[entry["path"]] = Sequence(entry["path"], digits, tuple(written))
    return found


def _written(time: dict[str, Any], sequences: dict[str, Sequence]) -> tuple[int, int]:
    if time.get("written"):
        return int(time["written"][0]), int(time["written"][1])
    if sequences:
        return min(s.first for s in sequences.values()), max(s.last for s in sequences.values())
    return int(time["start"]), int(time["end"])


def _material(entry: dict[str, Any]) -> dict[str, Any]:
    """A material whose values are all there and numbers."""
    params = entry["params"]
    cutoff = params.get("alpha_cutoff")
    return {
        "name": str(entry["name"]),
        "class": str(entry["class"]),
        "slots": {k: str(v) for k, v in entry["slots"].items() if v},
        "maps": {k: str(v) for k, v in entry["maps"].items() if v},
        "base_color": [float(c) for c in params["base_color"][:3]],
        "roughness": float(params["roughness"]),
        "ior": float(params["ior"]),
        "translucency": min(max(float(params.get("translucency") or 0.0), 0.0), 1.0),
        "alpha_cutoff": None if cutoff is None else float(cutoff),
        "vertex_colors": bool(params.get("vertex_colors")),
        # Of bark, which absorbs water; None stands for those of the bake.
        "wet_albedo": params.get("wet_albedo"),
        "wet_roughness": params.get("wet_roughness"),
    }


def _view(view: dict[str, Any]) -> dict[str, Any]:
    """Checks the shapes of camera, sun, sky and look; all numbers are finite."""
    if not view:
        return {}
    camera, sun, sky, look = view["camera"], view["sun"], view["sky"], view.get("look") or {}
    _numbers(camera["matrix"], 16), _numbers([camera["vfov_deg"]], 1), _numbers(camera["clip"], 2), _numbers(camera["size"], 2)
    _numbers(sun["toward"], 3), _numbers(sun["irradiance"], 3), _numbers([sun["angle_deg"]], 1)
    if not sky["stops"]:
        raise ValueError("a sky without colours")
    for at, color in sky["stops"]:
        _numbers([at, *color], 4)
    for at, share in sky.get("glow_stops") or []:
        _numbers([at, share], 2)
    if sky.get("glow"):
        _numbers(sky["glow"], 3)
    return {"camera": camera, "sun": sun, "sky": sky, "look": look}


def _numbers(values: Any, count: int) -> tuple[float, ...]:
    numbers = tuple(float(v) for v in values)
    if len(numbers) != count or not all(math.isfinite(v) for v in numbers):
        raise ValueError(f"{count} finite numbers expected")
    return numbers


def _places(folder: str, places: Any, assets: list[Asset]) -> list[Place]:
    if places is None:
        return []
    if isinstance(places, str):
        with open(os.path.join(folder, *places.split("/")), "rb") as file:
            rows = file.read()
        return [_row(row, assets) for row in struct.iter_unpack("<10f", rows)]
    known = {a.name for a in assets}
    for name in places:
        if name not in known:
            raise ValueError(f"places of {name}, which is no asset")
    entries = ((a.name, entry) for a in assets for entry in places.get(a.name, []))
    return [Place(name, _numbers(entry["matrix"], 16), float(entry.get("offset") or 0)) for name, entry in entries]


def _row(row: tuple[float, ...], assets: list[Asset]) -> Place:
    index, offset, px, py, pz, x, y, z, w, scale = _numbers(row, 10)
    if index < 0:
        raise IndexError("an asset below zero")
    s = scale
    return Place(
        assets[int(index)].name,
        (
            s * (1 - 2 * (y * y + z * z)), s * 2 * (x * y + z * w), s * 2 * (x * z - y * w), 0.0,
            s * 2 * (x * y - z * w), s * (1 - 2 * (x * x + z * z)), s * 2 * (y * z + x * w), 0.0,
            s * 2 * (x * z + y * w), s * 2 * (y * z - x * w), s * (1 - 2 * (x * x + y * y)), 0.0,
            px, py, pz, 1.0,
        ),
        offset,
    )  # fmt: skip


def _check_files(path: str, folder: str, needed: list[str]) -> None:
    for name in needed:
        parts = name.replace("\\", "/").split("/")
        if os.path.isabs(name) or ".." in parts or ":" in parts[0]:
            raise BakeError(path, f"the manifest names {name}, a file outside its folder", "Import only folders that osier has baked")
    missing = sorted({name for name in needed if not os.path.isfile(os.path.join(folder, *name.split("/")))})
    if missing:
        cause = f"{len(missing)} files of the bake are missing, the first is {missing[0]}"
        raise BakeError(path, cause, "Bake again, or copy the whole folder")
