# SPDX-License-Identifier: GPL-3.0-or-later
"""A panel that grows plants and bakes scenes with osier, and imports the result with the modules of osier_import."""

import bpy

from . import actions, ops, panel, pictures, properties, session, settings

# Read by Blender before 4.2, which has no extensions.
bl_info = {
    "name": "osier",
    "author": "osier contributors",
    "version": (0, 1, 0),
    "blender": (3, 4, 0),
    "location": "3D Viewport > Sidebar > osier",
    "description": "Grow plants, bake wind and rain, and import the result",
    "category": "Import-Export",
}

CLASSES = (*settings.CLASSES, *actions.CLASSES, *panel.CLASSES)


def register() -> None:
    """Registers the importer, the panel and what it holds. Starts nothing: the panel does when it is first drawn."""
    ops.register()
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.Scene.osier = bpy.props.PointerProperty(type=settings.OSIER_PG_settings)


def unregister() -> None:
    """Stops what runs and removes what `register` has added."""
    if bpy.app.timers.is_registered(session.tick):
        bpy.app.timers.unregister(session.tick)
    session.session.close()
    pictures.close()
    properties.uninstall()
    del bpy.types.Scene.osier
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
    ops.unregister()
