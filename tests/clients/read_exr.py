"""Prints what OpenEXR's own reader finds in a file, as JSON."""
import json
import sys

import OpenEXR

with OpenEXR.File(sys.argv[1]) as f:
    header = f.header()
    channels = f.channels()
    print(
        json.dumps(
            {
                "channels": {name: str(c.pixels.dtype) for name, c in channels.items()},
                "pixels": {name: c.pixels.astype("float64").tolist() for name, c in channels.items()},
                "compression": str(header["compression"]),
                "lineOrder": str(header["lineOrder"]),
                "keys": sorted(header.keys()),
                "software": header.get("software"),
                "comments": header.get("comments"),
                "parts": len(f.parts),
            }
        )
    )
