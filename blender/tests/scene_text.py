# SPDX-License-Identifier: GPL-3.0-or-later
"""Tables that are taken out of the text of a scene. Needs no Blender."""

import pathlib
import sys
import tomllib

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "osier"))

import scene_text

BEFORE = (
    'title = """A valley\n[terrain]\nand a \\"hill\\""""\n'
    "points = [ # of [a, b]\n  [1, 2],\n[3, 4],\n]\n"
    "[plants.\"terrain\"]\nword = '[terrain]' # [terrain]\n[plants.b.terrain]\nat = [\n[0],\n]\n"
)
AFTER = "[sun]\nelevation_deg = 40\nterrain = 3\n\n[[place]]\nplant = \"b\"\nat = [\n  0,\n  0,\n]"

TERRAINS = [
    "[terrain]\nsize = 60\n",
    "[terrain] # land\ncorners = [\n  20, 20,\n  [20],\n]\nnested = [\n[1, 2],\n[3, 4]\n]\n",
    "[ terrain ]\nsize = 60\n# the end of it\n\n",
    "['terrain']\nsize = 60\n",
    '["terrain"]\ncolor = "#332211"\n  [terrain.more]\n  at = [0, 0]\n',
    "[[terrain]]\nsize = 60\n[[terrain]]\nsize = 70\n",
]

for terrain in TERRAINS:
    text = BEFORE + terrain + AFTER
    assert "terrain" in tomllib.loads(text), text
    assert scene_text.without_table(text, "terrain") == BEFORE + AFTER, scene_text.without_table(text, "terrain")

for terrain in ("terrain = { size = 60, corners = [\n1, 2, 3, 4] }\n", "terrain.size = 60\nterrain . height = 3\n", '"terrain".size = 60\n'):
    assert "terrain" in tomllib.loads(terrain + BEFORE + AFTER), terrain
    assert scene_text.without_table(terrain + BEFORE + AFTER, "terrain") == BEFORE + AFTER, terrain

for text in ("", "\n", AFTER, BEFORE, "# only\n# comments"):
    assert scene_text.without_table(text, "terrain") == text, text

INLINE = (
    'seed = 3\nplace = [ # all\n  { plant = "a", at = [0, 0, 1] }, # one, two\n  { plant = "b # c, d", at = [\n2, 0, 1] },\n] # end\n'
    'solid = [{ name = "w", size = [1, 2, 3] }]\nplants = { a = { species = "oak", leaf = { blade = "x" } } }\n\n[wind]\nplace = 3\n'
)
text = INLINE
for name in ("plants", "place", "solid"):
    text = scene_text.with_headed_tables(text, name)
assert tomllib.loads(text) == tomllib.loads(INLINE), text
more = tomllib.loads(text + '[[place]]\nplant = "c"\n[[solid]]\nname = "v"\n[plants.c]\nmesh = "c.obj"\n')
assert [len(more[name]) for name in ("plants", "place", "solid")] == [2, 3, 2], more
for text in ("", BEFORE, AFTER, "# place = [1]\n"):
    assert scene_text.with_headed_tables(text, "place") == text, text
