# SPDX-License-Identifier: GPL-3.0-or-later
"""Small pictures of presets as icons."""

import os

import bpy.utils.previews

_icons: "bpy.utils.previews.ImagePreviewCollection | None" = None


def load(folder: str, names: list[str]) -> None:
    """Loads the pictures that are in a folder."""
    global _icons
    close()
    found = {name: os.path.join(folder, f"{name}.png") for name in names}
    found = {name: path for name, path in found.items() if os.path.isfile(path)}
    if found:
        _icons = bpy.utils.previews.new()
        for name, path in found.items():
            _icons.load(name, path, "IMAGE")


def loaded() -> bool:
    """Whether there are any pictures."""
    return _icons is not None


def icon(name: str) -> int:
    """The number of the icon of a preset; 0 for none."""
    return _icons[name].icon_id if _icons is not None and name in _icons else 0


def close() -> None:
    """Forgets all pictures."""
    global _icons
    if _icons is not None:
        bpy.utils.previews.remove(_icons)
        _icons = None
