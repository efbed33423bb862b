# SPDX-License-Identifier: GPL-3.0-or-later
"""A layout that notes what a panel draws, and fails as Blender's does for a property or an operator that does not exist."""

from types import ModuleType, SimpleNamespace
from typing import Any

import bpy


class Recorder:
    """Stands for a layout and all layouts in it."""

    def __init__(self, calls: list[str]) -> None:
        self._calls = calls

    def prop(self, data: Any, name: str, **options: Any) -> None:
        """A property: it must exist and its icon must be known."""
        assert name in data.bl_rna.properties, f"{data} has no property {name}"
        getattr(data, name)
        self._note("prop", name, options)

    def operator(self, name: str, **options: Any) -> SimpleNamespace:
        """A button: its operator must be registered. Values are set on what is returned."""
        group, _, short = name.partition(".")
        kind = getattr(getattr(bpy.ops, group), short).get_rna_type()
        self._note("operator", name, options)
        return Values(kind)

    def template_icon_view(self, data: Any, name: str, **options: Any) -> None:
        """A choice with pictures."""
        assert all(option in bpy.types.UILayout.bl_rna.functions["template_icon_view"].parameters for option in options)
        self.prop(data, name)

    def label(self, **options: Any) -> None:
        """A line of text."""
        self._note("label", options.get("text", ""), options)

    def progress(self, factor: float, text: str) -> None:
        """A bar."""
        assert 0 <= factor <= 1
        self._note("progress", text, {"factor": factor, "text": text})

    def row(self, **_options: Any) -> "Recorder":
        """A part of the layout."""
        return self

    column = box = row

    def _note(self, kind: str, name: str, options: dict[str, Any]) -> None:
        known = bpy.types.UILayout.bl_rna.functions[kind].parameters
        assert all(option in known for option in options), f"{kind} takes no {options}"
        icons = bpy.types.UILayout.bl_rna.functions["label"].parameters["icon"].enum_items
        assert options.get("icon", "NONE") in icons, options
        self._calls.append(f"{kind} {name}")


class Values:
    """Values of a button's operator."""

    def __init__(self, kind: Any) -> None:
        object.__setattr__(self, "_kind", kind)

    def __setattr__(self, name: str, _value: Any) -> None:
        assert name in self._kind.properties, f"{self._kind} has no property {name}"


def draw_all(panel: ModuleType) -> list[str]:
    """Draws all panels of the module that would be shown, and returns what they have drawn."""
    calls: list[str] = []
    for cls in panel.CLASSES:
        if not hasattr(cls, "poll") or cls.poll(bpy.context):
            cls.draw(SimpleNamespace(layout=Recorder(calls)), bpy.context)
    return calls
