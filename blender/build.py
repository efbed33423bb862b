# SPDX-License-Identifier: GPL-3.0-or-later
"""Packs the extension into a zip that Blender installs: build.py [FOLDER].

The same sources give the same bytes: order, dates and modes are fixed. Python's own compression library decides the rest, so
files are stored without compression.
"""

import pathlib
import sys
import zipfile

HERE = pathlib.Path(__file__).resolve().parent
DATE = (1980, 1, 1, 0, 0, 0)
"""The earliest date that a zip can hold."""


def build(folder: pathlib.Path, legacy: bool = False) -> pathlib.Path:
    """Writes the zip into `folder`. `legacy`: for Blender before 4.2, where all files are in a folder of the module's name."""
    source = HERE / "osier_import"
    version = next(
        line.split('"')[1] for line in (source / "blender_manifest.toml").read_text().splitlines() if line.startswith("version")
    )
    folder.mkdir(parents=True, exist_ok=True)
    target = folder / f"osier_import-{version}{'-legacy' if legacy else ''}.zip"
    with zipfile.ZipFile(target, "w", zipfile.ZIP_STORED) as packed:
        for path in sorted(source.iterdir()):
            if path.suffix not in (".py", ".toml"):
                continue
            entry = zipfile.ZipInfo(("osier_import/" if legacy else "") + path.name, DATE)
            entry.external_attr = 0o100644 << 16
            entry.create_system = 3
            packed.writestr(entry, path.read_bytes())
    return target


if __name__ == "__main__":
    out = pathlib.Path(sys.argv[1]) if len(sys.argv) > 1 else HERE.parent / "out"
    print(build(out))
    print(build(out, legacy=True))
