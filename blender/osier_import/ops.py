# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators, menu entry and handler of dropped files."""

import time

import bpy
from bpy.props import EnumProperty, StringProperty
from bpy_extras.io_utils import ImportHelper

from . import manifest, reload, stage

NEW_SCENE = ("NEW", "New Scene", "A new scene of its own; nothing else is changed")
SAME_SCENE = [
    ("THIS", "This Scene", "This scene, with frame rate, range, camera, sky and look of the bake"),
    ("APPEND", "Append", "This scene; its frame rate, range, camera, sky and look stay"),
]
"""Choices of the scene that a bake is imported into."""

LOOKS = [
    ("PREVIEW", "Preview", "Closest to the pictures of osier preview"),
    ("AGX", "AgX", "Blender's AgX with medium high contrast"),
    ("KEEP", "Keep", "The look of the scene stays"),
]
"""Choices of the view transform."""


def can_import(operator: type[bpy.types.Operator], context: bpy.types.Context) -> bool:
    """Whether stages can be imported now; else the operator's tooltip gives the reason."""
    if not bpy.app.build_options.usd:
        operator.poll_message_set("This Blender was built without USD")
        return False
    if context.mode != "OBJECT":
        operator.poll_message_set("Leave edit mode first")
        return False
    return True


class OSIER_OT_import(bpy.types.Operator, ImportHelper):
    """Import a folder baked by osier, with materials, light, camera and frame range"""

    bl_idname = "import_scene.osier"
    bl_label = "Import osier bake"
    bl_options = {"REGISTER", "UNDO", "PRESET"}

    filename_ext = ".json"
    filter_glob: StringProperty(default="manifest*.json", options={"HIDDEN"})
    into: EnumProperty(
        name="Into",
        items=[NEW_SCENE, *SAME_SCENE],
        default="NEW",
    )
    look: EnumProperty(
        name="Look",
        items=LOOKS,
        default="PREVIEW",
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return can_import(cls, context)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        # A dropped file needs its options, not a list of files.
        if self.properties.is_property_set("filepath"):
            return context.window_manager.invoke_props_dialog(self)
        return ImportHelper.invoke(self, context, event)

    def execute(self, context: bpy.types.Context) -> set[str]:
        began = time.perf_counter()
        try:
            bake = manifest.read(self.filepath)
            report = stage.import_bake(context, bake, self.into, self.look)
        except manifest.BakeError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        for note in report.notes:
            self.report({"INFO"}, note)
        count = len(report.collection.all_objects)
        self.report({"INFO"}, f"Imported {bake.scene}: {count} objects in {time.perf_counter() - began:.2f} s")
        return {"FINISHED"}


class OSIER_OT_reload(bpy.types.Operator):
    """Read baked folders again that have changed; own changes to objects and materials stay"""

    bl_idname = "osier.reload"
    bl_label = "Reload osier bakes"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return can_import(cls, context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        done, failed, linked = 0, False, False
        for collection in [c for c in bpy.data.collections if "osier_hash" in c]:
            try:
                bake = manifest.read(reload.manifest_path(collection))
                if bake.bake_hash == collection["osier_hash"]:
                    continue
                if not reload.is_own(collection):
                    source = collection.library or collection.override_library.reference.library
                    self.report({"WARNING"}, f"{collection.name} is linked from {source.filepath}: reload it in that file")
                    linked = True
                    continue
                notes = reload.reload_bake(context, collection, bake)
            except manifest.BakeError as error:
                self.report({"ERROR"}, str(error))
                failed = True
                continue
            done += 1
            for note in notes:
                self.report({"INFO"}, note)
        if failed and not done:
            return {"CANCELLED"}
        if done or not linked:
            self.report({"INFO"}, f"Reloaded {done} bakes" if done else "All bakes are up to date")
        return {"FINISHED"}


CLASSES: list[type] = [OSIER_OT_import, OSIER_OT_reload]

if hasattr(bpy.types, "FileHandler"):

    class OSIER_FH_manifest(bpy.types.FileHandler):
        """Imports a manifest that is dropped into a 3D viewport."""

        bl_idname = "OSIER_FH_manifest"
        bl_label = "osier bake"
        bl_import_operator = "import_scene.osier"
        bl_file_extensions = ".json"

        @classmethod
        def poll_drop(cls, context: bpy.types.Context) -> bool:
            return bool(context.area and context.area.type == "VIEW_3D")

    CLASSES.append(OSIER_FH_manifest)


def menu(self: bpy.types.Menu, _context: bpy.types.Context) -> None:
    """Entries of File > Import."""
    self.layout.operator(OSIER_OT_import.bl_idname, text="osier bake (manifest.json)")
    if any("osier_hash" in c for c in bpy.data.collections):
        self.layout.operator(OSIER_OT_reload.bl_idname)


_registered = False


def register() -> None:
    """Registers all classes and the menu entry, unless the other extension of osier has registered the same operators."""
    global _registered
    if hasattr(bpy.types, "IMPORT_SCENE_OT_osier"):
        return
    _registered = True
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.TOPBAR_MT_file_import.append(menu)


def unregister() -> None:
    """Removes what `register` has added."""
    global _registered
    if not _registered:
        return
    _registered = False
    bpy.types.TOPBAR_MT_file_import.remove(menu)
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
