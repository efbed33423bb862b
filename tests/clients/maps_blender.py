"""Prints the red values of pictures as Blender reads them, rows from the top, as JSON lists."""
import json
import sys

import bpy

out = []
for path in sys.argv[1:]:
    image = bpy.data.images.load(path)
    image.colorspace_settings.name = "Non-Color"
    (width, height), pixels = image.size, list(image.pixels)
    # Blender's rows run from the bottom.
    rows = [pixels[4 * width * y : 4 * width * (y + 1)] for y in reversed(range(height))]
    out.append([v for row in rows for v in row[0::4]])
print(json.dumps(out))
