# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel in the 3D viewport, tab osier: what it shows. It changes nothing while it is drawn."""

import textwrap
from typing import Any

import bpy

from . import pictures, properties, schema
from .session import scene_seed, session, source_of

SHOWN_FIELDS = 60
"""Most fields that are shown at once; a search finds the others."""

CHARACTER_WIDTH = 6.5
"""Mean width of a character in pixels, at a scale of the interface of 1; guessed from pictures of the panel."""


def groups(fields: list[schema.Field]) -> list[str]:
    """The parts of a scene in their order: its plants, then its first tables."""
    return list(dict.fromkeys(group_of(field) for field in fields))


def group_of(field: schema.Field) -> str:
    """The part of a scene that a field is shown in."""
    parts = schema.parts(field.path)
    return ".".join(parts[:2]) if parts[0] in ("plants", "clouds") else (parts[0] if len(parts) > 1 else "scene")


def shown_fields(settings: Any, fields: list[schema.Field]) -> list[schema.Field]:
    """The fields that fit a search, or those of the chosen part: its basic ones, or all."""
    if settings.search.strip():
        return [field for field in fields if schema.matches(field, settings.search)]
    chosen = settings.group if settings.group in groups(fields) else next(iter(groups(fields)), "")
    return [field for field in fields if group_of(field) == chosen and (field.basic or settings.show_all)]


class OSIER_PT_panel(bpy.types.Panel):
    """Grow and bake plants"""

    bl_idname = "OSIER_PT_panel"
    bl_label = "osier"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "osier"

    def draw(self, context: bpy.types.Context) -> None:
        scene, layout = context.scene, self.layout
        if session.needs_work(scene):
            # Only schedules the work: a panel may not change anything while it is drawn.
            session.wake()
        draw_source(layout, scene)
        draw_state(layout, scene, line_length(context))


class OSIER_PT_values(bpy.types.Panel):
    """Values of the scene"""

    bl_idname = "OSIER_PT_values"
    bl_parent_id = "OSIER_PT_panel"
    bl_label = "Values"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "osier"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return properties.group(context.scene) is not None and session.source == source_of(context.scene)

    def draw(self, context: bpy.types.Context) -> None:
        scene, layout = context.scene, self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        settings, held = scene.osier, properties.group(scene)
        layout.prop(settings, "search", text="", icon="VIEWZOOM")
        if not settings.search.strip():
            row = layout.row(align=True)
            row.prop(settings, "group_choice", text="")
            row.prop(settings, "show_all", text="", icon="PRESET", toggle=True)
        found = shown_fields(settings, session.fields)
        table, column = None, layout
        for field in found[:SHOWN_FIELDS]:
            if field.table != table:
                table = field.table
                layout.label(text=table or "scene")
                column = layout.column(align=True)
            column.prop(held, field.name, slider=is_slider(field))
        if len(found) > SHOWN_FIELDS:
            layout.label(text=f"{len(found) - SHOWN_FIELDS} more: search by name")
        layout.operator("osier.reset", icon="LOOP_BACK")


class OSIER_PT_objects(bpy.types.Panel):
    """Objects of Blender in the scene of osier"""

    bl_idname = "OSIER_PT_objects"
    bl_parent_id = "OSIER_PT_panel"
    bl_label = "Objects"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "osier"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        for number, item in enumerate(context.scene.osier.objects):
            row = layout.row(align=True)
            row.prop(item, "object", text="")
            row.prop(item, "role", text="")
            row.operator("osier.remove_object", text="", icon="X").index = number
        row = layout.row(align=True)
        row.operator("osier.add_objects", text="Add as Solids").role = "SOLID"
        row.operator("osier.add_objects", text="Add as Trees").role = "TREE"
        row.operator("osier.add_objects", text="Add as Terrain").role = "TERRAIN"


def is_slider(field: schema.Field) -> bool:
    """Whether the range of a number is narrow enough for a slider."""
    return field.kind == "number" and field.minimum is not None and field.maximum is not None and field.maximum - field.minimum <= 1000


def draw_source(layout: bpy.types.UILayout, scene: bpy.types.Scene) -> None:
    """What is baked: a preset with its picture or a file, and the seed."""
    settings = scene.osier
    if session.presets and not settings.file:
        if pictures.loaded():
            layout.template_icon_view(settings, "preset_choice", show_labels=True, scale=6.0)
        layout.prop(settings, "preset_choice", text="")
        layout.operator("osier.draw_presets", icon="RENDERLAYERS")
    row = layout.row(align=True)
    row.prop(settings, "file")
    row.operator("osier.retry", text="", icon="FILE_REFRESH")
    row = layout.row(align=True)
    row.prop(settings, "seed", text="Seed", placeholder=str(scene_seed())) if bpy.app.version >= (4, 1, 0) else row.prop(settings, "seed")
    row.operator("osier.step_seed", text="", icon="TRIA_LEFT").step = -1
    row.operator("osier.step_seed", text="", icon="TRIA_RIGHT").step = 1


def line_length(context: bpy.types.Context) -> int:
    """Characters that a line of the panel holds: Blender does not break lines, and cuts their middle out."""
    width = context.region.width if context.region else 0
    return max(int(width / (CHARACTER_WIDTH * context.preferences.system.ui_scale)) - 6, 24) if width else 80


def draw_state(layout: bpy.types.UILayout, scene: bpy.types.Scene, length: int) -> None:
    """The buttons, progress, and what osier has written, in lines of some length."""
    settings, job = scene.osier, session.job
    row = layout.row(align=True)
    row.prop(settings, "into", text="")
    row.prop(settings, "look", text="")
    if job is not None:
        text = job.stage or session.what
        if hasattr(layout, "progress"):
            layout.progress(factor=job.fraction(), text=text)
        else:
            layout.label(text=f"{text} {100 * job.fraction():.0f} %")
        layout.operator("osier.cancel", icon="CANCEL")
    else:
        layout.operator("osier.bake", icon="PLAY")
    for lines, icon in ((session.errors, "ERROR"), (session.notes, "INFO")):
        column = layout.column(align=True)
        broken = (part for text in lines for line in text.splitlines() for part in textwrap.wrap(line, length, drop_whitespace=False))
        for number, line in enumerate(broken):
            column.label(text=line, icon=icon if number == 0 else "BLANK1")


CLASSES = (OSIER_PT_panel, OSIER_PT_values, OSIER_PT_objects)
