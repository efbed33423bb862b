"""Draws wind-slices.png from planes that a bake writes (needs numpy, OpenEXR, pillow):

    cargo run --release -- bake docs/gallery/wind-slices.toml -o out/slices
    python3 docs/gallery/slices.py out/slices/wind 0097 docs/gallery/wind-slices.png
"""

import json
import sys
from pathlib import Path

import numpy as np
import OpenEXR
from PIL import Image, ImageDraw, ImageFont

SCALE = 8  # pixels a texel


def plane(path):
    part = OpenEXR.File(str(path)).parts[0]
    pixels = part.channels["RGB"].pixels
    said = part.header["comments"]
    return pixels, json.loads(said if isinstance(said, str) else said.decode())


def colored(values, low, high):
    """Blue below nothing, white at nothing, then yellow to red; what stands still in solids is grey."""
    stops = np.array([[20, 40, 120], [90, 140, 220], [255, 255, 255], [250, 200, 90], [200, 40, 30]], float)
    share = np.where(values < 0, 2 * (1 - values / low), 2 + 2 * values / high).clip(0, 4)
    k = np.minimum(share.astype(int), 3)
    return stops[k] + (stops[k + 1] - stops[k]) * (share - k)[..., None]


def panel(pixels, component, text, reach):
    values = pixels[..., component]
    picture = colored(values, -reach, reach)
    picture[(pixels == 0).all(axis=2)] = 90
    image = Image.fromarray(picture.round().astype(np.uint8)).resize(
        (values.shape[1] * SCALE, values.shape[0] * SCALE), Image.NEAREST)
    draw = ImageDraw.Draw(image)
    draw.text((8, 6), text, fill=(0, 0, 0), font=ImageFont.load_default(18))
    return image


def main(folder, frame, out):
    side, a = plane(folder / f"z0.{frame}.exr")
    above, b = plane(folder / f"y1_75.{frame}.exr")
    reach = 5.0
    panels = [
        panel(side, 0, f"along the wind, {-reach:g} to {reach:g} m/s: from the side, z = {a['at_m']:g} m", reach),
        panel(side, 1, "upwards, half the scale", reach / 2),
        panel(above, 0, f"along the wind: from above, y = {b['at_m']:g} m", reach),
        panel(above, 2, "across (+z is down), half the scale", reach / 2),
    ]
    gap = 6
    whole = Image.new("RGB", (panels[0].width, sum(p.height + gap for p in panels) - gap), "white")
    y = 0
    for p in panels:
        whole.paste(p, (0, y))
        y += p.height + gap
    whole.save(out, optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2], Path(sys.argv[3]))
