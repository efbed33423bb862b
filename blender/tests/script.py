# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs the scripts of this folder to an end that the caller sees."""

import os
import sys
import traceback
from collections.abc import Callable
from typing import NoReturn


def run(main: Callable[[], None]) -> NoReturn:
    """Calls `main` and ends the process: with 0, after an exception with 1 and its text.

    Blender 4.5 as a module may not end by itself while an add-on is registered, neither with a result nor with an error.
    """
    code = 0
    try:
        main()
    except BaseException:
        traceback.print_exc()
        code = 1
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)
