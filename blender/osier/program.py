# SPDX-License-Identifier: GPL-3.0-or-later
"""Where the program osier is and how it is started. Does not need Blender."""

import importlib.util
import os
import sys

START = "import sys; sys.path.insert(0, sys.argv[1]); import osier; sys.exit(osier.main(sys.argv[2:]))"
"""What Python runs: the program of the wheel, whose folder is the first argument."""

OVERRIDE = "OSIER_PROGRAM"
"""Environment variable with the path of a program that replaces the wheel. For the development of osier only."""


class NoProgramError(Exception):
    """The wheel is not installed."""


def wheel_folder() -> str:
    """The folder into which Blender has unpacked the wheel.

    Raises `NoProgramError`.
    """
    spec = importlib.util.find_spec("osier")
    package = os.path.dirname(spec.origin) if spec and spec.origin else ""
    if not package or not any(name.startswith("osier.") and name.endswith((".so", ".pyd")) for name in os.listdir(package)):
        raise NoProgramError("the program osier is missing: install the extension from the zip for your platform")
    return os.path.dirname(package)


def command(arguments: list[str]) -> list[str]:
    """The command that runs osier with `arguments` in a process of its own.

    Raises `NoProgramError`.
    """
    override = os.environ.get(OVERRIDE)
    if override:
        return [override, *arguments]
    return [sys.executable, "-I", "-c", START, wheel_folder(), *arguments]
