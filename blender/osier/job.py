# SPDX-License-Identifier: GPL-3.0-or-later
"""A run of osier in the background, read without waiting. Does not need Blender."""

import atexit
import json
import os
import queue
import signal
import subprocess
import threading
import time
from typing import IO, Any

from . import program

PATIENCE = 3.0
"""Seconds after which a cancelled process that still runs is killed. osier itself ends within 1.5 s."""


class Job:
    """A process in a group of its own. `step` takes what it has written; call it from a timer until it returns False."""

    def __init__(self, arguments: list[str], folder: str) -> None:
        """Starts osier in `folder`. Raises `program.NoProgramError` or `OSError`."""
        group: dict[str, Any] = {"start_new_session": True}
        if os.name == "nt":
            group = {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}
        self.arguments = arguments
        self.code: int | None = None
        self.stage, self.done, self.total = "", 0, 0
        self.output = ""
        self.errors: list[str] = []
        self.warnings: list[str] = []
        self.began = time.monotonic()
        self._cancelled: float | None = None
        self._lines: queue.SimpleQueue[tuple[str, str]] = queue.SimpleQueue()
        self._process = subprocess.Popen(
            program.command(arguments),
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            encoding="utf-8",
            errors="replace",
            **group,
        )
        self._readers = [
            threading.Thread(target=self._read, args=(pipe, name), daemon=True)
            for pipe, name in ((self._process.stdout, "out"), (self._process.stderr, "err"))
        ]
        for reader in self._readers:
            reader.start()
        # The process has a group of its own and would outlive Blender.
        atexit.register(self.cancel)

    def _read(self, pipe: IO[str], name: str) -> None:
        with pipe:
            for line in pipe:
                self._lines.put((name, line.rstrip("\n")))

    def step(self) -> bool:
        """Takes what the process has written since the last call. Returns False once it has ended and all is read."""
        if self.code is not None:
            return False
        # Asked before the lines are taken, so that none of them is missed.
        ended = self._process.poll() is not None and not any(r.is_alive() for r in self._readers)
        while not self._lines.empty():
            name, line = self._lines.get()
            if name == "out":
                self.output += line + "\n"
            else:
                self._take(line)
        if ended:
            self.code = self._process.returncode
            atexit.unregister(self.cancel)
        elif self._cancelled is not None and time.monotonic() - self._cancelled > PATIENCE:
            self._send(getattr(signal, "SIGKILL", signal.SIGTERM))
        return not ended

    def _take(self, line: str) -> None:
        """A line of standard error: an event as JSON, or plain text."""
        try:
            event = json.loads(line)
        except ValueError:
            event = None
        if not isinstance(event, dict):
            if line.strip():
                self.errors.append(line)
            return
        kind = event.get("event")
        if kind == "progress":
            self.stage, self.done, self.total = event["stage"], event["done"], event["total"]
        elif kind in ("error", "warning"):
            (self.errors if kind == "error" else self.warnings).extend(event_lines(event))

    def fraction(self) -> float:
        """Share done of the present stage, 0 to 1."""
        return min(self.done / self.total, 1.0) if self.total else 0.0

    def cancel(self) -> None:
        """Asks the process to stop; `step` tells when it has."""
        if self._cancelled is None and self.code is None:
            self._cancelled = time.monotonic()
            self._send(signal.SIGTERM)

    @property
    def is_cancelled(self) -> bool:
        """Whether `cancel` was called."""
        return self._cancelled is not None

    def wait(self, seconds: float) -> bool:
        """Waits for the end, for scripts. Returns whether it was reached."""
        end = time.monotonic() + seconds
        while self.step():
            if time.monotonic() > end:
                return False
            time.sleep(0.01)
        return True

    def _send(self, number: int) -> None:
        try:
            if os.name == "nt":
                self._process.terminate()
            else:
                os.killpg(self._process.pid, number)
        except ProcessLookupError:
            pass


def event_lines(event: dict[str, Any]) -> list[str]:
    """An error or a warning as lines of text, with its place and its help."""
    code = f"[{event['code']}]" if event.get("code") else ""
    lines = [f"{event['event']}{code}: {event['message']}"]
    if event.get("file"):
        place = [str(event[key]) for key in ("file", "line", "column") if event.get(key) is not None]
        lines.append("  " + ":".join(place))
    if event.get("help"):
        lines.append(f"  help: {event['help']}")
    return lines
