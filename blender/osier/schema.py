# SPDX-License-Identifier: GPL-3.0-or-later
"""What a scene of osier lets one change, as fields with ranges and defaults. Does not need Blender."""

import hashlib
import json
import os
import re
import struct
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

LISTS = frozenset({
    "place", "scatter", "solid", "layer", "rod", "rod.clamp", "rod.load", "flight.zone", "rain.lying", "wind.add",
    "plants.NAME.turtle.tropisms", "clouds.NAME.morph.key", "output.wind.slice",
})  # fmt: skip
"""Tables of which a scene may have several: their keys exist for those that the scene has."""

HIDDEN = ("seed", "output.formats")
"""Keys that the panel sets in its own way."""

LARGEST = 2**31 - 1
"""Largest whole number that a number field of Blender holds."""

NAME_LENGTH = 60
"""Longest name of a property; Blender allows 63 bytes."""


@dataclass(frozen=True)
class Field:
    """A key of a scene. `value` is what the scene has, in the type of `kind`."""

    path: str
    kind: str
    value: Any
    minimum: float | None = None
    maximum: float | None = None
    step: float | None = None
    choices: tuple[str, ...] = ()
    unit: str = ""
    help: str = ""
    basic: bool = False

    @property
    def name(self) -> str:
        """Name of the property: `wind.speed` becomes `wind__speed`."""
        name = re.sub(r"\W", "_", self.path.replace(".", "__"), flags=re.ASCII)
        if len(name) > NAME_LENGTH or name != self.path.replace(".", "__"):
            name = name[: NAME_LENGTH - 9] + "_" + hashlib.sha256(self.path.encode()).hexdigest()[:8]
        return name

    @property
    def table(self) -> str:
        """What the panel shows above the fields of a table."""
        return self.path.rpartition(".")[0]

    @property
    def label(self) -> str:
        """What the panel shows beside the value."""
        return self.path.rpartition(".")[2].replace("_", " ").capitalize()


def fields(options: list[dict[str, Any]], check: dict[str, Any]) -> list[Field]:
    """The fields of a scene: of `osier list options --json` and of its entry in `osier check SCENE --json`."""
    given = {key["key"]: key["value"] for key in check["keys"]}
    found: dict[str, Field] = {}
    for knob in check["knobs"]:
        if knob["number"] is not None:
            value = float(given.get(knob["key"], knob["number"]))
            # A scene may have a value beyond the range of its grammar; the field must be able to return to it.
            low, high = knob["min"], knob["max"]
            low, high = low if low is None else min(low, value), high if high is None else max(high, value)
            found[knob["key"]] = Field(knob["key"], "number", value, low, high, None, (), knob["unit"], knob["about"], True)
    for option in options:
        for table in (option["table"], *option["also"]):
            for place in _tables(table, given):
                path = f"{place}.{option['key']}" if place else option["key"]
                if path not in HIDDEN and path not in found:
                    found[path] = _field(path, option, given)
    return list(found.values())


def _tables(pattern: str, given: dict[str, Any]) -> list[str]:
    """The tables of a scene that match a pattern such as `plants.NAME.bark`."""
    places = [""]
    parts = pattern.split(".") if pattern else []
    for i, part in enumerate(parts):
        if part in ("NAME", "LETTER"):
            places = [f"{p}.{name}" for p in places for name in _below(p, given) if not name.isdigit()]
        else:
            places = [f"{p}.{part}" if p else part for p in places]
        if ".".join(parts[: i + 1]) in LISTS:
            places = [f"{p}.{number}" for p in places for number in _below(p, given) if number.isdigit()]
    return places


def _below(place: str, given: dict[str, Any]) -> list[str]:
    """The names that follow a path in the keys of a scene."""
    start = place + "."
    return list(dict.fromkeys(parts(key[len(start) :])[0] for key in given if key.startswith(start)))


def parts(path: str) -> list[str]:
    """The parts of a path between its dots. A name with dots stands in quotes and keeps these: `plants."v1.2".steps`."""
    return re.findall(r'"[^"]*"|[^.]+', path)


def plants(given: Iterable[str]) -> list[str]:
    """The names of the plants of a scene, from its keys."""
    return list(dict.fromkeys(parts(key)[1].strip('"') for key in given if key.startswith("plants.")))


def _field(path: str, option: dict[str, Any], given: dict[str, Any]) -> Field:
    value = given[path] if path in given else option["initial"]
    kind, value = _typed(option, value)
    return Field(
        path, kind, value, option["min"], option["max"], option["step"], tuple(map(str, option["choices"])), option["unit"], option["help"],
        option["basic"],
    )  # fmt: skip


def _typed(option: dict[str, Any], value: Any) -> tuple[str, Any]:
    """The kind of a field and its value in the type of that kind. What no other field can hold is text as in a scene file."""
    kind = option["kind"]
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if kind == "number" and number:
        return kind, float(value)
    if kind == "whole" and option["choices"]:
        # A field of a number would also take those between the sizes of pictures, which osier refuses.
        return "size", str(value)
    if kind == "whole" and number and (option["max"] or 0) <= LARGEST and abs(value) <= LARGEST:
        return kind, int(value)
    if kind == "whole" and number and (option["max"] or 0) > LARGEST:
        return "seed", str(value)
    if kind == "flag" and isinstance(value, bool):
        return kind, value
    if kind == "choice" and value in option["choices"]:
        return kind, value
    if kind == "choices" and isinstance(value, list) and all(v in option["choices"] for v in value):
        return kind, tuple(value)
    if kind == "vector" and isinstance(value, list) and len(value) == option["length"]:
        return kind, tuple(float(v) for v in value)
    if kind == "color" and value is not None:
        return kind, linear(value)
    if kind in ("text", "file") and (value is None or isinstance(value, str)):
        return kind, value or ""
    return "toml", "" if value is None else toml(value)


def linear(color: str | list[float]) -> tuple[float, ...]:
    """A colour of a scene, `"#rrggbb"` in sRGB or three linear numbers, as linear numbers."""
    if not isinstance(color, str):
        return tuple(float(c) for c in color)
    parts = [int(color[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    return tuple(c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts)


def single(value: float) -> float:
    """The nearest number of 32 bits, which is what a field of Blender holds."""
    return struct.unpack("f", struct.pack("f", value))[0]


def number_text(value: float) -> str:
    """The shortest decimal number that a field of 32 bits holds as `value`."""
    for digits in range(1, 10):
        text = f"{value:.{digits}g}"
        if single(float(text)) == single(value):
            break
    plain = float(text)
    return str(int(plain)) if plain == int(plain) and abs(plain) < 1e15 else repr(plain)


def toml(value: Any) -> str:
    """A value of JSON as a value of a scene file."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{json.dumps(k)} = {toml(v)}" for k, v in value.items()) + " }" if value else "{}"
    if isinstance(value, list):
        return "[" + ", ".join(toml(v) for v in value) + "]"
    return json.dumps(value, ensure_ascii=False)


def value_text(field: Field, value: Any) -> str:
    """The value of a field as in a scene file."""
    if field.kind == "number":
        return number_text(value)
    if field.kind in ("vector", "color"):
        return "[" + ", ".join(number_text(v) for v in value) + "]"
    if field.kind == "seed":
        # Whole numbers of a scene file have 63 bits; larger seeds are written as text.
        return value if value.isdigit() and int(value) < 2**63 else toml(value)
    if field.kind == "choices":
        return toml([c for c in field.choices if c in value])
    return value if field.kind in ("toml", "size") else toml(value)


def is_changed(field: Field, value: Any) -> bool:
    """Whether a value is unlike that of the scene, as far as a field of Blender can tell."""
    if field.kind == "number":
        return single(value) != single(field.value)
    if field.kind in ("vector", "color"):
        return [single(v) for v in value] != [single(v) for v in field.value]
    if field.kind == "choices":
        return set(value) != set(field.value)
    return value != field.value


def arguments(changed: list[tuple[Field, Any]]) -> list[str]:
    """The flags that give a scene other values. Empty text is no value: the key keeps its own.

    A scene names files by relative paths, so that the folder of an absolute one becomes a folder to search.
    """
    flags = []
    for field, value in changed:
        if not is_changed(field, value) or (field.kind in ("file", "seed", "size", "toml") and value == ""):
            continue
        if field.kind == "file" and os.path.isabs(value):
            folder, value = os.path.split(value)
            flags += ["--search", folder]
        flags += ["--set", f"{field.path}={value_text(field, value)}"]
    return flags


def seed_number(text: str) -> int | None:
    """The seed that a text field holds: a whole number of 64 bits, or None."""
    return int(text) if re.fullmatch(r"[0-9]{1,20}", text.strip()) and int(text) < 2**64 else None


def matches(field: Field, search: str) -> bool:
    """Whether a field has all words of a search at the beginnings of its own words."""
    text = f"{field.path} {field.help}".lower()
    return all(re.search(r"(?<![a-z0-9])" + re.escape(word), text) for word in search.lower().split())
