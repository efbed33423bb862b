"""Prints what OpenEXR's own reader finds in a file, as JSON. With x y width height: of that part of the picture."""
import json
import sys

import OpenEXR

part = [int(v) for v in sys.argv[2:6]]


def cut(pixels):
    if not part:
        return pixels
    x, y, width, height = part
    return pixels[y : y + height, x : x + width]


with OpenEXR.File(sys.argv[1]) as f:
    header = f.header()
    channels = f.channels()
    print(
        json.dumps(
            {
                "channels": {name: str(c.pixels.dtype) for name, c in channels.items()},
                "pixels": {name: cut(c.pixels).astype("float64").tolist() for name, c in channels.items()},
                "compression": str(header["compression"]),
                "lineOrder": str(header["lineOrder"]),
                "keys": sorted(header.keys()),
                "software": header.get("software"),
                "comments": header.get("comments"),
                "parts": len(f.parts),
            }
        )
    )
