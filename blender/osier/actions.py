# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators of the panel."""

from collections.abc import Iterator

import bpy
from bpy.props import EnumProperty, IntProperty

from . import objects, properties, schema
from .session import scene_seed, session, source_of


class OSIER_OT_bake(bpy.types.Operator):
    """Bake the scene in the background and import the result; the next bake replaces it in place"""

    bl_idname = "osier.bake"
    bl_label = "Bake"
    # A step of its own, so that undo of the import keeps the folder that the first bake gave to the scene.
    bl_options = {"UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if session.is_busy:
            cls.poll_message_set("osier is running")
            return False
        if session.source != source_of(context.scene):
            cls.poll_message_set("The values of the scene are not read yet")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        session.bake(context.scene)
        if session.job is None:
            self.report({"ERROR"}, session.errors[0] if session.errors else "osier did not start")
            return {"CANCELLED"}
        return {"FINISHED"}


class OSIER_OT_cancel(bpy.types.Operator):
    """Stop osier; finished files are kept"""

    bl_idname = "osier.cancel"
    bl_label = "Cancel"

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        return session.job is not None

    def execute(self, _context: bpy.types.Context) -> set[str]:
        session.cancel()
        return {"FINISHED"}


class OSIER_OT_retry(bpy.types.Operator):
    """Read the scene again, after it was changed or an error was mended"""

    bl_idname = "osier.retry"
    bl_label = "Read Again"

    def execute(self, _context: bpy.types.Context) -> set[str]:
        session.retry()
        return {"FINISHED"}


class OSIER_OT_reset(bpy.types.Operator):
    """Reset all values to those of the preset or file"""

    bl_idname = "osier.reset"
    bl_label = "Reset Values"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return properties.group(context.scene) is not None

    def execute(self, context: bpy.types.Context) -> set[str]:
        properties.reset(context.scene, session.fields)
        context.scene.osier.property_unset("seed")
        return {"FINISHED"}


class OSIER_OT_step_seed(bpy.types.Operator):
    """The seed before or after this one: another individual"""

    bl_idname = "osier.step_seed"
    bl_label = "Next Seed"
    bl_options = {"REGISTER", "UNDO"}

    step: IntProperty(default=1)

    def execute(self, context: bpy.types.Context) -> set[str]:
        settings = context.scene.osier
        seed = schema.seed_number(settings.seed) if settings.seed.strip() else scene_seed()
        if seed is None:
            self.report({"ERROR"}, "The seed is a whole number from 0 to 2^64 - 1")
            return {"CANCELLED"}
        settings.seed = str((seed + self.step) % 2**64)
        return {"FINISHED"}


class OSIER_OT_draw_presets(bpy.types.Operator):
    """Draw a small picture of every preset, which takes a few minutes"""

    bl_idname = "osier.draw_presets"
    bl_label = "Draw Pictures of Presets"

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        return not session.is_busy

    def execute(self, _context: bpy.types.Context) -> set[str]:
        session.draw_thumbnails()
        if session.job is None:
            self.report({"ERROR"}, session.errors[0] if session.errors else "osier did not start")
            return {"CANCELLED"}
        return {"FINISHED"}


class OSIER_OT_add_objects(bpy.types.Operator):
    """Add the selected objects to the scene of osier; they are exported at each bake"""

    bl_idname = "osier.add_objects"
    bl_label = "Add Selected Objects"
    bl_options = {"REGISTER", "UNDO"}

    role: EnumProperty(name="Role", items=objects.ROLES)

    def execute(self, context: bpy.types.Context) -> set[str]:
        listed = context.scene.osier.objects
        known = {item.object for item in listed}
        chosen = set(context.selected_objects)
        # Objects below another one are exported with it, as the leaves of a tree.
        heads = [o for o in context.selected_objects if not chosen.intersection(ancestors(o))]
        added = [o for o in heads if objects.usable(o) and o not in known and "osier_bake" not in o]
        for selected in added:
            item = listed.add()
            item.object, item.role = selected, self.role
        if not added:
            self.report({"WARNING"}, "Select objects with a surface that are not listed and not made by osier")
            return {"CANCELLED"}
        return {"FINISHED"}


def ancestors(item: bpy.types.Object) -> Iterator[bpy.types.Object]:
    """The parent of an object, its parent, and so on."""
    while item.parent is not None:
        item = item.parent
        yield item


class OSIER_OT_remove_object(bpy.types.Operator):
    """Remove an object from this list; the object stays"""

    bl_idname = "osier.remove_object"
    bl_label = "Remove Object"
    bl_options = {"REGISTER", "UNDO"}

    index: IntProperty()

    def execute(self, context: bpy.types.Context) -> set[str]:
        context.scene.osier.objects.remove(self.index)
        return {"FINISHED"}


CLASSES = (
    OSIER_OT_bake,
    OSIER_OT_cancel,
    OSIER_OT_retry,
    OSIER_OT_reset,
    OSIER_OT_step_seed,
    OSIER_OT_draw_presets,
    OSIER_OT_add_objects,
    OSIER_OT_remove_object,
)
