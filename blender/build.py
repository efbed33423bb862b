# SPDX-License-Identifier: GPL-3.0-or-later
"""Packs the extensions into zips that Blender installs: build.py [FOLDER] [--wheel WHEEL].

Without a wheel, `osier_import` alone is packed. With a wheel of osier, the extension `osier` for the wheel's platform is packed, too:
its own modules, those of the importer, and the wheel.

The same sources give the same bytes: order, dates and modes are fixed. Python's own compression library decides the rest, so
files are stored without compression; a wheel is compressed itself.
"""

import argparse
import pathlib
import re
import zipfile

HERE = pathlib.Path(__file__).resolve().parent
DATE = (1980, 1, 1, 0, 0, 0)
"""The earliest date that a zip can hold."""

PLATFORMS = {
    r"manylinux.*x86_64": "linux-x64",
    r"manylinux.*aarch64": "linux-arm64",
    r"linux_x86_64": "linux-x64",
    r"macosx.*arm64": "macos-arm64",
    r"macosx.*x86_64": "macos-x64",
    r"win_amd64": "windows-x64",
    r"win_arm64": "windows-arm64",
}
"""Blender's names of the platforms that the name of a wheel ends with."""


def modules(name: str) -> dict[str, bytes]:
    """The files of an extension in `blender/` and their license, by name."""
    paths = (path for path in (HERE / name).iterdir() if path.suffix in (".py", ".toml"))
    return {path.name: path.read_bytes() for path in [*sorted(paths), HERE / "LICENSE"]}


def version(files: dict[str, bytes]) -> str:
    """The version that the manifest of an extension gives."""
    lines = files["blender_manifest.toml"].decode().splitlines()
    return next(line.split('"')[1] for line in lines if line.startswith("version"))


def pack(target: pathlib.Path, files: dict[str, bytes]) -> pathlib.Path:
    """Writes a zip of files by their paths in it."""
    target.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(target, "w", zipfile.ZIP_STORED) as packed:
        for path, content in sorted(files.items()):
            entry = zipfile.ZipInfo(path, DATE)
            entry.external_attr = 0o100644 << 16
            entry.create_system = 3
            packed.writestr(entry, content)
    return target


def build_import(folder: pathlib.Path, legacy: bool = False) -> pathlib.Path:
    """Packs `osier_import`. `legacy`: for Blender before 4.2, where all files are in a folder of the module's name."""
    files = modules("osier_import")
    target = folder / f"osier_import-{version(files)}{'-legacy' if legacy else ''}.zip"
    return pack(target, {("osier_import/" if legacy else "") + name: content for name, content in files.items()})


def platform(wheel: str) -> str:
    """Blender's name of the platform of a wheel."""
    tag = wheel.removesuffix(".whl").rsplit("-", 1)[-1]
    found = next((name for pattern, name in PLATFORMS.items() if re.fullmatch(pattern, tag)), None)
    if found is None:
        raise SystemExit(f"{wheel}: Blender has no platform {tag}")
    return found


def build_panel(folder: pathlib.Path, wheel: pathlib.Path) -> pathlib.Path:
    """Packs `osier` with its wheel."""
    own, system = modules("osier"), platform(wheel.name)
    text = own["blender_manifest.toml"].decode()
    for key, value in (("platforms", system), ("wheels", f"./wheels/{wheel.name}")):
        text = re.sub(rf'^{key} = \[.*\]$', f'{key} = ["{value}"]', text, count=1, flags=re.MULTILINE)
    importer = {name: content for name, content in modules("osier_import").items() if name not in own}
    files = {**importer, **own, "blender_manifest.toml": text.encode(), f"wheels/{wheel.name}": wheel.read_bytes()}
    return pack(folder / f"osier-{version(own)}-{system}.zip", files)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", nargs="?", type=pathlib.Path, default=HERE.parent / "out")
    parser.add_argument("--wheel", type=pathlib.Path, help="a wheel of osier, which the extension osier needs")
    chosen = parser.parse_args()
    print(build_import(chosen.folder))
    print(build_import(chosen.folder, legacy=True))
    if chosen.wheel:
        print(build_panel(chosen.folder, chosen.wheel))


if __name__ == "__main__":
    main()
