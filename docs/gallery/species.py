#!/usr/bin/env python3
"""Makes the pictures of docs/gallery/species.md again: docs/gallery/species.py [NAME...]. Needs pillow; OSIER names the program.

A picture has four parts: the tree at six ages, to one scale; three individuals; a look from near; the tree in four seasons, unless
it is evergreen. Ten to forty seconds a species.
"""

import os
import subprocess
import sys
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).resolve().parents[2]
OSIER = os.environ.get("OSIER", str(ROOT / "target/release/osier"))
WORK = ROOT / "out/gallery-species"
# Size of a panel in pixels, columns of the seasons, and the quality of the JPEG that keeps a picture below 160 kB.
PANEL = "176x214"
SEASON = "269x270"
MOST_BYTES = 158_000

LONG, SHORT = "5,10,20,40,60,90", "3,5,8,12,20,35"
# Times of the growing year: unfolding, autumn, the fall of leaves, winter.
SEASONS = "0.1,0.72,0.9,1"
EVERGREEN = {"acacia", "spruce", "pine", "cypress", "thuja"}
# Scene: ages, and the camera near the crown as eye and target, m.
SPECIES = {
    "oak-grown": (LONG, (10.5, 4.0, 3.5, 7.0, 5.5, 0.5)),
    "beech": (LONG, (11.5, 6.0, 3.5, 7.5, 7.2, 0.5)),
    "birch-grown": (LONG, (5.5, 7.0, 3.5, 2.6, 8.4, 0.5)),
    "linden": (LONG, (11.0, 5.5, 3.5, 7.0, 6.8, 0.5)),
    "ash": (LONG, (9.5, 10.5, 3.5, 5.8, 12.2, 0.5)),
    "maple": (LONG, (9.5, 6.0, 3.5, 5.8, 7.2, 0.5)),
    "cherry": ("5,10,20,30,40,60", (8.6, 5.0, 3.5, 5.2, 6.5, 0.5)),
    "poplar": ("3,5,10,20,28,35", (3.8, 7.0, 2.6, 1.0, 9.0, 0.3)),
    "cottonwood": ("3,6,10,18,30,45", (9.5, 5.0, 3.5, 5.8, 7.0, 0.5)),
    "willow": ("3,5,10,15,25,35", (7.8, 3.0, 3.0, 4.2, 4.2, 0.5)),
    "apple": (SHORT, (5.2, 1.9, 2.0, 2.8, 2.9, 0.2)),
    "japanese-maple": (SHORT, (4.6, 1.7, 1.6, 2.6, 2.5, 0.2)),
    "hazel": ("2,4,6,10,16,24", (5.4, 1.8, 2.2, 2.8, 2.8, 0.2)),
    "acacia": (SHORT, (6.0, 3.2, 2.4, 3.4, 4.6, 0.4)),
    "spruce": ("5,10,20,30,40,50", (6.6, 3.6, 1.6, 3.2, 3.6, 0.0)),
    "pine": ("5,10,20,40,70,110", (7.2, 13.0, 2.6, 3.0, 15.2, 0.2)),
    "larch": ("5,10,20,30,40,50", (5.8, 3.0, 2.0, 2.6, 4.6, 0.2)),
    "cypress": ("3,5,10,20,30,40", (3.4, 5.0, 1.8, 0.6, 6.0, 0.2)),
    "thuja": ("3,5,10,20,30,40", (4.2, 3.6, 2.0, 1.2, 4.4, 0.2)),
}


def draw(scene, name, *flags):
    picture = WORK / f"{name}.png"
    command = [OSIER, "preview", "-q", str(scene), "--search", str(ROOT / "species"), "-o", str(picture), "--force"]
    subprocess.run([*command, *flags], check=True)
    return Image.open(picture).convert("RGB")


def make(name):
    ages, camera = SPECIES[name]
    scene = ROOT / f"scenes/{name}.toml"
    text = scene.read_text()
    plant = next(line for line in text.splitlines() if line.startswith("plant = ")).split('"')[1]
    sweep = ("--seed", "2", "--sweep", f"plants.{plant}.age={ages}", "--columns", "6")
    ages = draw(scene, f"{name}-ages", "--size", PANEL, *sweep)
    seeds = draw(scene, f"{name}-seeds", "--size", PANEL, "--seeds", "1,3,4", "--columns", "3")
    near = WORK / f"{name}.toml"
    eye, target = [", ".join(map(str, part)) for part in (camera[:3], camera[3:])]
    near.write_text(f"{text}\n[camera]\neye = [{eye}]\ntarget = [{target}]\nvfov_deg = 32\n")
    size = (ages.width - seeds.width, seeds.height)
    close = draw(near, f"{name}-near", "--size", f"{size[0]}x{size[1]}", "--seed", "2", "--view", "scene")
    rows = [ages, seeds]
    if name not in EVERGREEN:
        # Seasons of the tree of the first row at the age of its scene.
        rows.append(draw(scene, f"{name}-seasons", "--size", SEASON, "--seed", "2", "--sweep", f"season={SEASONS}", "--columns", "4"))
    sheet = Image.new("RGB", (ages.width, sum(row.height for row in rows)), "white")
    sheet.paste(ages, (0, 0))
    sheet.paste(seeds, (0, ages.height))
    sheet.paste(close, (seeds.width, ages.height))
    for row in rows[2:]:
        sheet.paste(row, (0, ages.height + seeds.height))
    out = ROOT / f"docs/gallery/species-{name.removesuffix('-grown')}.jpg"
    for quality in range(86, 40, -4):
        sheet.save(out, quality=quality, optimize=True)
        if out.stat().st_size < MOST_BYTES:
            break
    print(out.name, out.stat().st_size, flush=True)


if __name__ == "__main__":
    WORK.mkdir(parents=True, exist_ok=True)
    for species in sys.argv[1:] or SPECIES:
        make(species)
