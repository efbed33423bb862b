# SPDX-License-Identifier: GPL-3.0-or-later
"""Imports bakes of osier: objects, materials, light, camera and frame range as the manifest of the bake describes them."""

from . import ops

# Read by Blender before 4.2, which has no extensions.
bl_info = {
    "name": "osier Import",
    "author": "osier contributors",
    "version": (0, 1, 0),
    "blender": (3, 4, 0),
    "location": "File > Import > osier bake",
    "description": "Import baked plants, rain and seeds, ready to render",
    "category": "Import-Export",
}


def register() -> None:
    """Registers the operators, the menu entry and the handler of dropped files."""
    ops.register()


def unregister() -> None:
    """Removes what `register` has added."""
    ops.unregister()
