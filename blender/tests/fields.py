# SPDX-License-Identifier: GPL-3.0-or-later
"""The fields of a scene: fields.py OPTIONS CHECK.

OPTIONS is the output of `osier list options --json`, CHECK that of `osier check SCENE --json`. Needs no Blender. Prints the paths of the
fields and the names of the plants as JSON.
"""

import json
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "osier"))

import schema

options, check = (json.loads(pathlib.Path(path).read_text(encoding="utf-8")) for path in sys.argv[1:])
fields = schema.fields(options, check[0])
plants = schema.plants(key["key"] for key in check[0]["keys"])
print(json.dumps({"paths": [field.path for field in fields], "plants": plants}))
