#!/usr/bin/env python3
"""Makes the pictures of docs/growth.md that show growth again: docs/gallery/growth.py [NAME...]. Needs pillow; OSIER names the program.

oak-years.jpg is one oak at eight ages, growth-species.jpg four species at the ages of their tables, oak-rules.jpg a bare oak without
one rule of growth after the other; within a picture all panels have one scale. About two minutes.
"""

import sys

from PIL import Image, ImageDraw, ImageFont

from species import ROOT, WORK, draw

GAP = 6
BACKGROUND = "#f6f5f1"
# What each panel of oak-rules changes of the habit of the oak; without light there would be more wood than the limit of nodes allows.
RULES = [
    ("all rules", []),
    ("little shade (extinction 0.1)", ["extinction=0.1"]),
    ("no shedding", ["shed=0", "bare_max=1000"]),
    ("no path limit", ["path_max=200"]),
    ("no apical control", ["apical_control=[0.5]", "apical_control_old=[0.5]"]),
    ("no elevation, no righting", ["elevation_rate=[0]", "upright=[0]"]),
    ("no wander, no apex death", ["wander=[0]", "apex_death=[0]"]),
    ("no bending", ["sag=[0]"]),
]
# Size of a panel, pixels; columns; distance of the camera, m, and height that it looks at, m; and the panels as scene, plant, age, seed.
PICTURES = {
    "oak-years": ((320, 320), 4, 34.0, 6.6, [("oak-grown", "oak", age, 2) for age in range(5, 41, 5)]),
    "growth-species": (
        (300, 325),
        4,
        52.0,
        11.5,
        [("oak-grown", "oak", 60, 2), ("birch-grown", "birch", 45, 4), ("beech", "beech", 60, 1), ("linden", "linden", 60, 1)],
    ),
}
# Age and seed of the oak of oak-rules, its columns, and its camera as in PICTURES; the same oak has all rules in the first panel.
RULES_AGE, RULES_SEED, RULES_PICTURE = 60, 2, ((320, 300), 4, 50.0, 10.5)
# Vertical angle of view, degrees, and height of the eye, m.
VFOV, EYE = 32, 2.2
QUALITY = 88


def sheet_of(size, columns, count):
    rows = -(-count // columns)
    return Image.new("RGB", (columns * (size[0] + GAP) - GAP, rows * (size[1] + GAP) - GAP), BACKGROUND)


def panel(scene, name, size, distance, middle, *flags):
    """The scene by itself, from `distance`, looking at the height `middle`, m."""
    text = (ROOT / f"scenes/{scene}.toml").read_text()
    camera = f"[camera]\neye = [{0.5 * distance}, {EYE}, {0.866 * distance}]\ntarget = [0, {middle}, 0]\nvfov_deg = {VFOV}\n"
    path = WORK / f"{scene}.toml"
    path.write_text(f"{text}\n{camera}")
    return draw(path, name, "--size", "x".join(map(str, size)), "--view", "scene", *flags)


def save(sheet, name):
    out = ROOT / f"docs/gallery/{name}.jpg"
    sheet.save(out, quality=QUALITY, optimize=True)
    print(out.name, out.stat().st_size, flush=True)


def make(name):
    size, columns, distance, middle, panels = PICTURES[name]
    sheet = sheet_of(size, columns, len(panels))
    for i, (scene, plant, age, seed) in enumerate(panels):
        flags = ("--seed", str(seed), "--set", f"plants.{plant}.age={age}")
        one = panel(scene, f"{name}-{i}", size, distance, middle, *flags)
        sheet.paste(one, (i % columns * (size[0] + GAP), i // columns * (size[1] + GAP)))
    save(sheet, name)


def make_rules():
    size, columns, distance, middle = RULES_PICTURE
    sheet = sheet_of(size, columns, len(RULES))
    font = ImageFont.load_default(15)
    for i, (text, keys) in enumerate(RULES):
        flags = ["--seed", str(RULES_SEED), "--set", f"plants.oak.age={RULES_AGE}", "--set", "plants.oak.season=1"]
        for key in keys:
            flags += ["--set", f"plants.oak.habit.{key}"]
        one = panel("oak-grown", f"rules-{i}", size, distance, middle, *flags)
        ImageDraw.Draw(one).text((8, 6), text, "#1c2430", font)
        sheet.paste(one, (i % columns * (size[0] + GAP), i // columns * (size[1] + GAP)))
    save(sheet, "oak-rules")


if __name__ == "__main__":
    WORK.mkdir(parents=True, exist_ok=True)
    wanted = sys.argv[1:]
    for picture in PICTURES:
        if not wanted or picture in wanted:
            make(picture)
    if not wanted or "oak-rules" in wanted:
        make_rules()
