# SPDX-License-Identifier: GPL-3.0-or-later
"""The fields of a scene as properties of Blender's scene, so that undo, redo and saved files keep their values."""

from typing import Any

import bpy
from bpy.props import (
    BoolProperty,
    EnumProperty,
    FloatProperty,
    FloatVectorProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)

from .schema import LARGEST, Field

ATTRIBUTE = "osier_values"
"""Name of the group of values on a scene."""

_classes: list[type] = []


def install(fields: list[Field]) -> None:
    """Replaces the group of values by one with these fields. Values that scenes hold under equal names stay."""
    uninstall()
    annotations = {field.name: _property(field) for field in fields}
    group = type("OSIER_PG_values", (bpy.types.PropertyGroup,), {"__annotations__": annotations})
    bpy.utils.register_class(group)
    _classes.append(group)
    setattr(bpy.types.Scene, ATTRIBUTE, PointerProperty(type=group))


def uninstall() -> None:
    """Removes the group of values. Scenes keep the values for a later group."""
    if hasattr(bpy.types.Scene, ATTRIBUTE):
        delattr(bpy.types.Scene, ATTRIBUTE)
    while _classes:
        bpy.utils.unregister_class(_classes.pop())


def group(scene: bpy.types.Scene) -> Any:
    """The values of a scene, or None before a schema is known."""
    return getattr(scene, ATTRIBUTE, None)


def values(scene: bpy.types.Scene, fields: list[Field]) -> list[tuple[Field, Any]]:
    """Every field with its value in a scene."""
    held = group(scene)
    return [(field, _plain(field, getattr(held, field.name))) for field in fields] if held else []


def reset(scene: bpy.types.Scene, fields: list[Field]) -> None:
    """Gives every field the value of the scene of osier."""
    held = group(scene)
    for field in fields:
        held.property_unset(field.name)


def _plain(field: Field, value: Any) -> Any:
    if field.kind in ("vector", "color"):
        return tuple(value)
    if field.kind == "file" and value:
        return bpy.path.abspath(value)
    return value


def _property(field: Field) -> Any:
    text = f"{field.help} [{field.path}{', ' + field.unit if field.unit else ''}]"
    common = {"name": field.label, "description": text, "default": field.value}
    if field.kind == "number":
        return FloatProperty(**common, **_range(field), step=_step(field), precision=_precision(field.value))
    if field.kind == "whole":
        return IntProperty(**common, **{k: int(v) for k, v in _range(field).items()})
    if field.kind == "size":
        # Each has itself as its number, as which files of an earlier version hold it.
        return EnumProperty(**common, items=[(c, c, "", int(c)) for c in field.choices])
    if field.kind == "vector":
        return FloatVectorProperty(**common, **_range(field), size=len(field.value), subtype="XYZ" if len(field.value) == 3 else "NONE")
    if field.kind == "color":
        return FloatVectorProperty(**common, min=0.0, soft_max=1.0, size=3, subtype="COLOR")
    if field.kind == "flag":
        return BoolProperty(**common)
    if field.kind in ("choice", "choices"):
        items = [(c, c.replace("_", " ").capitalize(), "", 1 << i if field.kind == "choices" else i) for i, c in enumerate(field.choices)]
        if field.kind == "choices":
            return EnumProperty(**{**common, "default": set(field.value)}, items=items, options={"ENUM_FLAG"})
        return EnumProperty(**common, items=items)
    return StringProperty(**common, subtype="FILE_PATH" if field.kind == "file" else "NONE")


def _range(field: Field) -> dict[str, float]:
    """The bounds of a number. Whole numbers of Blender have 32 bits."""
    bounds = {"min": field.minimum, "max": field.maximum}
    if field.kind == "whole":
        bounds = {k: None if v is None else max(-LARGEST, min(v, LARGEST)) for k, v in bounds.items()}
    return {k: v for k, v in bounds.items() if v is not None}


def _step(field: Field) -> int:
    """What the arrows of a field add, in hundredths."""
    return max(1, min(int(round((field.step or 0.1) * 100)), 10000))


def _precision(value: float) -> int:
    """Digits after the point that a field shows: three that count, at least two."""
    digits = 2
    while digits < 6 and 0 < abs(value) < 10 ** (2 - digits) * 10:
        digits += 1
    return digits
