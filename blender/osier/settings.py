# SPDX-License-Identifier: GPL-3.0-or-later
"""Properties and preferences of the panel that do not depend on a schema."""

from typing import Any

import bpy
from bpy.props import BoolProperty, CollectionProperty, EnumProperty, IntProperty, PointerProperty, StringProperty

from . import objects, panel, pictures
from .ops import LOOKS, SAME_SCENE
from .session import session

_items: dict[str, list[tuple[str, str, str, str | int, int]]] = {}
"""Items of the choices: Blender does not keep the text of items that are made by a function."""


def _preset_items(_settings: Any, _context: bpy.types.Context | None) -> list:
    names = [(p["name"].removesuffix(".toml"), p) for p in session.presets]
    _items["presets"] = [(name, name, p["about"], pictures.icon(p["name"]), i) for i, (name, p) in enumerate(names)]
    return _items["presets"]


def _group_items(_settings: Any, _context: bpy.types.Context | None) -> list:
    _items["groups"] = [(name, name, "", "NONE", i) for i, name in enumerate(panel.groups(session.fields))]
    return _items["groups"]


def _chosen(items: Any, name: str) -> Any:
    """A function that gives the number of the item whose name a text property holds: numbers change with the list, names do not."""

    def get(settings: Any) -> int:
        return next((item[4] for item in items(settings, None) if item[0] == getattr(settings, name)), 0)

    return get


def _choose(items: Any, name: str) -> Any:
    """A function that puts the name of the item with a number into a text property."""

    def choose(settings: Any, number: int) -> None:
        setattr(settings, name, next(item[0] for item in items(settings, None) if item[4] == number))

    return choose


def _changed(_settings: Any, _context: bpy.types.Context) -> None:
    session.wake()


class OSIER_PG_object(bpy.types.PropertyGroup):
    """An object of Blender in the scene of osier"""

    object: PointerProperty(name="Object", type=bpy.types.Object, poll=lambda _self, item: objects.usable(item))
    role: EnumProperty(name="Role", items=objects.ROLES)


class OSIER_PG_settings(bpy.types.PropertyGroup):
    """What a scene of Blender bakes"""

    preset: StringProperty(name="Preset", default="oak", update=_changed)
    preset_choice: EnumProperty(
        name="Preset", description="The plant or scene to bake", items=_preset_items,
        get=_chosen(_preset_items, "preset"), set=_choose(_preset_items, "preset"),
    )  # fmt: skip
    file: StringProperty(name="File", description="A scene file of your own instead of a preset", subtype="FILE_PATH", update=_changed)
    seed: StringProperty(name="Seed", description="Another whole number grows another individual; empty: that of the scene")
    search: StringProperty(name="Search", description="Words of the name or the help of a value", options={"TEXTEDIT_UPDATE"})
    group: StringProperty()
    group_choice: EnumProperty(
        name="Part", description="Part of the scene whose values are shown", items=_group_items,
        get=_chosen(_group_items, "group"), set=_choose(_group_items, "group"),
    )  # fmt: skip
    show_all: BoolProperty(name="All", description="Show all values, not only the basic ones")
    into: EnumProperty(
        name="Into",
        items=SAME_SCENE,
    )
    look: EnumProperty(
        name="Look",
        items=LOOKS,
    )
    objects: CollectionProperty(type=OSIER_PG_object)
    token: StringProperty()


class OSIER_AP_preferences(bpy.types.AddonPreferences):
    """Preferences of the extension"""

    bl_idname = __package__

    folder: StringProperty(name="Bakes", description="Folder of bakes; empty: the folder of this extension, which is removed with it", subtype="DIR_PATH")
    threads: IntProperty(name="Threads", description="Threads of a bake; 0: all", min=0, max=256)

    def draw(self, _context: bpy.types.Context) -> None:
        self.layout.prop(self, "folder")
        self.layout.prop(self, "threads")


CLASSES = (OSIER_PG_object, OSIER_PG_settings, OSIER_AP_preferences)
