#!/usr/bin/env python3
"""Makes the two pictures of docs/growth.md that show growth again: docs/gallery/growth.py. Needs pillow; OSIER names the program.

oak-years.jpg is one oak at eight ages, growth-species.jpg four species at the ages of their tables; within a picture all panels have one
scale. About a minute.
"""

from PIL import Image

from species import ROOT, WORK, draw

GAP = 6
BACKGROUND = "#f6f5f1"
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
# Vertical angle of view, degrees, and height of the eye, m.
VFOV, EYE = 32, 2.2
QUALITY = 88


def make(name):
    size, columns, distance, middle, panels = PICTURES[name]
    rows = -(-len(panels) // columns)
    sheet = Image.new("RGB", (columns * (size[0] + GAP) - GAP, rows * (size[1] + GAP) - GAP), BACKGROUND)
    for i, (scene, plant, age, seed) in enumerate(panels):
        text = (ROOT / f"scenes/{scene}.toml").read_text()
        camera = f"[camera]\neye = [{0.5 * distance}, {EYE}, {0.866 * distance}]\ntarget = [0, {middle}, 0]\nvfov_deg = {VFOV}\n"
        path = WORK / f"{scene}.toml"
        path.write_text(f"{text}\n{camera}")
        flags = ("--size", "x".join(map(str, size)), "--seed", str(seed), "--set", f"plants.{plant}.age={age}", "--view", "scene")
        panel = draw(path, f"{name}-{i}", *flags)
        sheet.paste(panel, (i % columns * (size[0] + GAP), i // columns * (size[1] + GAP)))
    out = ROOT / f"docs/gallery/{name}.jpg"
    sheet.save(out, quality=QUALITY, optimize=True)
    print(out.name, out.stat().st_size, flush=True)


if __name__ == "__main__":
    WORK.mkdir(parents=True, exist_ok=True)
    for picture in PICTURES:
        make(picture)
