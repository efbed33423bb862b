"""Draws street-landings.png from the maps of the sweep of street.md (needs numpy, OpenEXR, pillow):

    cargo run --release -- bake catkins-street-plan --sweep solid.0.size.1=0.05,1,2,3,4 --seeds 0-7
    python3 docs/gallery/street.py out/catkins_street_plan-sweep docs/gallery/street-landings.png
"""

import json
import sys
from pathlib import Path

import numpy as np
import OpenEXR
from PIL import Image, ImageDraw, ImageFont

SCALE = 7  # pixels a texel
MOST = 20.0  # landings per m^2 at the end of the scale; at the wall more, since clusters touch it again and again
STOPS = np.array([[255, 255, 255], [254, 224, 144], [253, 141, 60], [203, 24, 29], [70, 0, 20]], float)
WALL = (3.85, -10, 4.15, 10)  # x and z of two corners, m
HOUSE = (7, -5, 15, 5)
TREES = [(-9, -5), (-9, 5)]


def field(path):
    part = OpenEXR.File(str(path)).parts[0]
    said = part.header["comments"]
    return part.channels["Y"].pixels, json.loads(said if isinstance(said, str) else said.decode())


def colored(share):
    """White at 0 to dark red at 1, on a square-root scale."""
    at = np.sqrt(share.clip(0, 1)) * (len(STOPS) - 1)
    k = np.minimum(at.astype(int), len(STOPS) - 2)
    return (STOPS[k] + (STOPS[k + 1] - STOPS[k]) * (at - k)[..., None]).round().astype(np.uint8)


def panel(values, about, most, text):
    image = Image.fromarray(colored(values / most)).resize(
        (values.shape[1] * SCALE, values.shape[0] * SCALE), Image.NEAREST)
    draw = ImageDraw.Draw(image)
    (x0, _, z0), per_metre = about["corner_m"], SCALE * values.shape[1] / about["along_m"][0]
    at = lambda x, z: ((x - x0) * per_metre, (z - z0) * per_metre)
    draw.rectangle([at(*HOUSE[:2]), at(*HOUSE[2:])], fill=(170, 170, 170), outline=(60, 60, 60))
    draw.rectangle([at(*WALL[:2]), at(*WALL[2:])], fill=(60, 60, 60))
    for tree in TREES:
        x, z = at(*tree)
        draw.ellipse([x - 5, z - 5, x + 5, z + 5], fill=(60, 130, 60))
    draw.text((6, 4), text, fill=(0, 0, 0), font=ImageFont.load_default(18))
    draw.rectangle([0, 0, image.width - 1, image.height - 1], outline=(120, 120, 120))
    return image


def legend(size, most):
    image = Image.new("RGB", size, "white")
    draw = ImageDraw.Draw(image)
    bar = np.tile(np.linspace(0, 1, size[0] - 80), (24, 1))
    image.paste(Image.fromarray(colored(bar)), (40, 60))
    draw.rectangle([40, 60, size[0] - 41, 84], outline=(120, 120, 120))
    font = ImageFont.load_default(16)
    draw.text((40, 34), "landings per square metre of ground, mean of the seeds", fill=(0, 0, 0), font=font)
    for value in [0, 2, 5, 10, 20]:
        text = f"{value}+" if value == most else str(value)
        draw.text((40 + value / most * (size[0] - 80), 90), text, fill=(0, 0, 0), font=font, anchor="ma")
    draw.text((40, 130), "wind from the left; green: trunks, black: wall, grey: house", fill=(0, 0, 0), font=font)
    draw.text((40, 154), "40 m by 20 m", fill=(0, 0, 0), font=font)
    return image


def main(folder, out):
    choices = sorted(p for p in (folder / "maps").iterdir() if p.is_dir())
    maps = [field(p / "ground_mean.exr") for p in choices]
    panels = [panel(*m, MOST, f"wall of {p.name.split('_')[1]} m") for m, p in zip(maps, choices)]
    panels.append(legend(panels[0].size, MOST))
    gap, (width, height) = 8, panels[0].size
    rows = (len(panels) + 1) // 2
    whole = Image.new("RGB", (2 * width + gap, rows * (height + gap) - gap), "white")
    for i, p in enumerate(panels):
        whole.paste(p, (i % 2 * (width + gap), i // 2 * (height + gap)))
    whole.quantize(128).save(out, optimize=True)


main(Path(sys.argv[1]), sys.argv[2])
