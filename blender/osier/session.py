# SPDX-License-Identifier: GPL-3.0-or-later
"""What the panel knows and does: it asks osier about a scene, bakes it, and imports the result.

One process runs at a time. `tick` goes on with the work and is called by a timer, or by a script until it returns None.
"""

import contextlib
import json
import os
import pathlib
import re
import time
import uuid
from collections.abc import Callable
from typing import Any

import bpy

from . import manifest, objects, pictures, properties, reload, schema, stage
from .job import Job, event_lines
from .program import NoProgramError

INTERVAL = 0.1
"""Seconds between two calls of `tick`."""

FORMATS = "usd,exr"
"""What the importer reads."""

SHOWN_LINES = 40
"""Lines of errors that are kept."""

FAILURES = (NoProgramError, OSError, ValueError, KeyError)
"""What can go wrong around the program; the text is shown."""


class Session:
    """State that is not part of a file. `presets` and `fields` come from osier."""

    def __init__(self) -> None:
        self.presets: list[dict[str, Any]] = []
        self.options: list[dict[str, Any]] = []
        self.check: dict[str, Any] = {}
        self.fields: list[schema.Field] = []
        self.source: str | None = None
        self.errors: list[str] = []
        self.notes: list[str] = []
        self.job: Job | None = None
        self.what = ""
        self._then: Callable[[Job], None] | None = None
        self._import: str | None = None
        self._failed: str | None = None
        """The source that osier could not be asked about. Another one is tried again."""

    @property
    def is_busy(self) -> bool:
        """Whether a process runs or a bake waits to be imported."""
        return self.job is not None or self._import is not None

    def wake(self) -> None:
        """Starts the timer, if there is something to do."""
        if not bpy.app.timers.is_registered(tick):
            bpy.app.timers.register(tick, first_interval=INTERVAL)

    def retry(self) -> None:
        """Forgets a failure and asks osier again."""
        self._failed, self.errors, self.source = None, [], None
        self.wake()

    def needs_work(self, scene: bpy.types.Scene) -> bool:
        """Whether `tick` would do something."""
        source = source_of(scene)
        is_known = self.presets and self.options and self.source == source
        return self.is_busy or not (is_known or self._failed == source)

    def step(self) -> bool:
        """Goes on with the work without waiting. Returns False when nothing is left to do."""
        scene = bpy.context.scene
        if self.job is not None:
            if not self.job.step():
                job, then = self.job, self._then
                self.job = self._then = None
                self._guarded(lambda: then(job))
        elif self._import is not None:
            self._guarded(lambda: self._show_when_possible(scene))
        elif self.needs_work(scene):
            self._guarded(lambda: self._ask(scene))
        return self.needs_work(scene)

    def cancel(self) -> None:
        """Stops the process that runs."""
        if self.job is not None:
            self.job.cancel()

    def close(self) -> None:
        """Stops the process and waits for its end, before the extension is disabled."""
        if self.job is not None:
            self.job.cancel()
            self.job.wait(5.0)
        self.__init__()

    def bake(self, scene: bpy.types.Scene) -> None:
        """Starts a bake of the scene with its values. Needs the schema of the scene."""
        self.errors, self.notes = [], []
        if scene.osier.objects:
            self._guarded(lambda: self._copy_scene(scene))
        else:
            self._guarded(lambda: self._bake(scene, source_of(scene), []))
        self.wake()

    def draw_thumbnails(self) -> None:
        """Draws pictures of all presets into the folder of bakes, which takes a few minutes."""
        self._guarded(self._draw_thumbnails)
        self.wake()

    def _draw_thumbnails(self) -> None:
        folder = thumbnails_folder()
        os.makedirs(folder, exist_ok=True)
        self._start("Drawing presets", ["list", "presets", "--json", "--thumbnails", folder], self._take_presets)

    def _guarded(self, action: Callable[[], None]) -> None:
        """Runs a part of the work; a failure becomes lines of the panel."""
        try:
            action()
        except (*FAILURES, manifest.BakeError) as error:
            self._fail([str(error)])

    def _fail(self, lines: list[str]) -> None:
        self.errors = lines[-SHOWN_LINES:]
        self._failed = source_of(bpy.context.scene)

    def _start(self, what: str, arguments: list[str], then: Callable[[Job], None]) -> None:
        self.job = Job(arguments, bakes_folder())
        self.what, self._then = what, then

    def _ask(self, scene: bpy.types.Scene) -> None:
        """Asks osier for what is not known yet."""
        if not self.presets:
            self._start("Reading presets", ["list", "presets", "--json"], self._take_presets)
        elif not self.options:
            self._start("Reading keys", ["list", "options", "--json"], self._take_options)
        else:
            source = source_of(scene)
            self._start(f"Reading {os.path.basename(source)}", ["check", source, "--json"], lambda job: self._take_check(job, source))

    def _read(self, job: Job) -> Any:
        """The result of a process as JSON, or None after a failure, which is shown."""
        if job.is_cancelled or not job.output:
            self._fail(job.errors or [f"osier ended with code {job.code}"])
            return None
        return json.loads(job.output)

    def _take_presets(self, job: Job) -> None:
        listed = self._read(job)
        if listed is not None:
            self.presets = [p for p in listed if p["kind"] in ("species", "scene")]
            pictures.load(thumbnails_folder(), [p["name"] for p in self.presets])

    def _take_options(self, job: Job) -> None:
        self.options = self._read(job) or []

    def _take_check(self, job: Job, source: str) -> None:
        listed = self._read(job)
        if listed is None:
            return
        self.source, self.check = source, listed[0]
        self.errors = [line for d in self.check["diagnostics"] if d["severity"] == "error" for line in diagnostic_lines(d)]
        if self.check["error"]:
            self.errors.append(self.check["error"])
        self.fields = schema.fields(self.options, self.check)
        properties.install(self.fields)

    def _copy_scene(self, scene: bpy.types.Scene) -> None:
        """Makes a copy of the scene for osier, to which objects are added."""
        source, folder = source_of(scene), bake_folder(scene) + ".scene"
        objects.fresh_folder(folder)
        if os.path.isfile(source):
            text = pathlib.Path(source).read_text(encoding="utf-8")
            self._bake_copy(scene, folder, text, ["--search", os.path.dirname(source)])
        else:
            copied = os.path.join(folder, source)
            self._start("Baking: copying the scene", ["new", copied, "--from", source, "--json"], lambda job: self._take_copy(job, copied))

    def _take_copy(self, job: Job, copied: str) -> None:
        if job.code != 0 or job.is_cancelled:
            self._ended(job)
            return
        scene = scene_with(os.path.basename(os.path.dirname(copied)).removesuffix(".scene"))
        if scene is None:
            self.notes = ["The scene to bake was closed"]
            return
        # The scene is the first file; in its name `poplar-twig` is `poplar_twig`.
        text = pathlib.Path(json.loads(job.output)["files"][0]).read_text(encoding="utf-8")
        self._bake_copy(scene, copied, text, [])

    def _bake_copy(self, scene: bpy.types.Scene, folder: str, text: str, flags: list[str]) -> None:
        items = [item for item in scene.osier.objects if objects.usable(item.object)]
        given = [key["key"] for key in self.check["keys"]]
        path = objects.write_scene(folder, source_name(scene), text, given, schema.plants(given), items)
        self._bake(scene, path, flags)

    def _bake(self, scene: bpy.types.Scene, source: str, flags: list[str]) -> None:
        folder = bake_folder(scene)
        arguments = ["bake", source, "-o", folder, "--formats", FORMATS, *flags, *scene_arguments(scene, self.fields), "--progress", "json"]
        threads = preference("threads", 0)
        if threads:
            arguments += ["-j", str(threads)]
        self._start(f"Baking {source_name(scene)}", arguments, lambda job: self._take_bake(job, folder))

    def _take_bake(self, job: Job, folder: str) -> None:
        if job.code == 0:
            self.notes = job.warnings[-SHOWN_LINES:]
            self.notes.append(f"Baked in {time.monotonic() - job.began:.1f} s")
            self._import = os.path.join(folder, "manifest.json")
        else:
            self._ended(job)

    def _ended(self, job: Job) -> None:
        """A bake without a result. The state before stays; another bake may follow."""
        if job.is_cancelled:
            self.notes = ["Cancelled"]
        else:
            self.errors = (job.errors or [f"osier ended with code {job.code}"])[-SHOWN_LINES:]

    def _show_when_possible(self, scene: bpy.types.Scene) -> None:
        """Imports what was baked once its scene is open and no object is being edited."""
        path = self._import
        wanted = scene_with(os.path.basename(os.path.dirname(path)))
        if wanted is None:
            self._import = None
            self.notes.append(f"The scene that was baked is closed; the bake is in {os.path.dirname(path)}")
        elif wanted == scene:
            if bpy.context.mode == "OBJECT":
                self._import = None
                self._show(scene, path)
        elif window := window_with(wanted):
            # Another window shows the scene that was baked.
            with bpy.context.temp_override(window=window):
                if bpy.context.mode == "OBJECT":
                    self._import = None
                    self._show(wanted, path)

    def _show(self, scene: bpy.types.Scene, path: str) -> None:
        """Imports a bake, or reloads it where it was imported before."""
        if not bpy.app.build_options.usd:
            self.errors = [f"{path}: this Blender was built without USD and cannot import the bake"]
            return
        try:
            bake = manifest.read(path)
            # The name of the folder is that of this scene alone; the folder itself may have moved with the project.
            name = os.path.basename(bake.folder)
            earlier = [c for c in scene.collection.children_recursive if reload.is_own(c) and os.path.basename(c.get("osier_folder", "")) == name]
            if not earlier:
                self.notes += stage.import_bake(bpy.context, bake, scene.osier.into, scene.osier.look).notes
            elif (earlier[0]["osier_hash"], earlier[0]["osier_manifest"]) != (bake.bake_hash, bake.path):
                self.notes += reload.reload_bake(bpy.context, earlier[0], bake)
            else:
                self.notes.append("The scene shows this bake already")
        except manifest.BakeError as error:
            self.errors = [str(error)]
            return
        bpy.ops.ed.undo_push(message="Bake with osier")


session = Session()
"""The only session."""


def tick() -> float | None:
    """Goes on with the work; for `bpy.app.timers`."""
    manager = bpy.context.window_manager
    window = next(iter(manager.windows), None) if manager and bpy.context.window is None else None
    # A timer has no window, which Blender's USD importer and the scene that is shown belong to.
    with bpy.context.temp_override(window=window) if window else contextlib.nullcontext():
        busy = session.step()
    redraw()
    return INTERVAL if busy else None


def redraw() -> None:
    """Draws the panels of all windows again."""
    manager = bpy.context.window_manager
    for window in manager.windows if manager else ():
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()


def diagnostic_lines(diagnostic: dict[str, Any]) -> list[str]:
    """An entry of `osier check --json` as lines."""
    label = (diagnostic["labels"] or [{}])[0]
    place = {key: label.get(key) for key in ("file", "line", "column")}
    return event_lines({"event": diagnostic["severity"], **place, **{k: diagnostic[k] for k in ("code", "message", "help")}})


def source_of(scene: bpy.types.Scene) -> str:
    """What osier bakes: the user's scene file, or a preset."""
    own = scene.osier.file
    return bpy.path.abspath(own) if own else scene.osier.preset


def scene_with(folder: str) -> bpy.types.Scene | None:
    """The scene of this file that bakes into a folder of this name."""
    return next((s for s in bpy.data.scenes if s.osier.token and folder.endswith("-" + s.osier.token)), None)


def window_with(scene: bpy.types.Scene) -> bpy.types.Window | None:
    """A window that shows a scene."""
    manager = bpy.context.window_manager
    return next((w for w in (manager.windows if manager else ()) if w.scene == scene), None)


def source_name(scene: bpy.types.Scene) -> str:
    """The name of the source, as osier names its scene."""
    return os.path.basename(source_of(scene)).removesuffix(".toml")


def scene_arguments(scene: bpy.types.Scene, fields: list[schema.Field]) -> list[str]:
    """The flags of a bake that say what the user has changed. Raises `ValueError` for a seed that is no number."""
    flags = []
    if scene.osier.seed.strip():
        seed = schema.seed_number(scene.osier.seed)
        if seed is None:
            raise ValueError("the seed is a whole number from 0 to 2^64 - 1")
        flags = ["--seed", str(seed)]
    return flags + schema.arguments(properties.values(scene, fields))


def scene_seed() -> int:
    """The seed that the scene of osier has."""
    given = next((k["value"] for k in session.check.get("keys", []) if k["key"] == "seed"), 1)
    return int(given)


def preference(name: str, default: Any) -> Any:
    """A preference of the extension, or `default` while it runs from a folder of sources."""
    addon = bpy.context.preferences.addons.get(__package__)
    return getattr(addon.preferences, name) if addon else default


def bakes_folder() -> str:
    """The folder of bakes, which is made if it is missing. Raises `OSError` where it cannot be made."""
    folder = bpy.path.abspath(preference("folder", ""))
    if not os.path.isabs(folder):
        # Empty, or relative to a file that is not saved yet.
        folder = default_folder()
    try:
        os.makedirs(folder, exist_ok=True)
    except OSError as error:
        step = "Choose another folder of bakes in the preferences of the extension osier"
        raise OSError(f"{folder}: the folder of bakes cannot be made ({error.strerror}). {step}") from error
    return folder


def default_folder() -> str:
    """The folder that Blender gives to this extension."""
    try:
        return bpy.utils.extension_path_user(__package__, path="bakes", create=True)
    except (AttributeError, ValueError):
        # Before 4.2, and from a folder of sources.
        return bpy.utils.user_resource("DATAFILES", path="osier", create=True)


def thumbnails_folder() -> str:
    """Where pictures of presets are."""
    return os.path.join(bakes_folder(), "presets")


TOKEN = re.compile("[0-9a-f]{8}")
"""What names the folders of a scene. Another text, as a changed file may have, names none."""


def bake_folder(scene: bpy.types.Scene) -> str:
    """The folder that a scene bakes its source into. Each scene has folders of its own, which the next bake replaces."""
    token = scene.osier.token
    # A copied scene has the token of its original until it bakes.
    is_shared = any(s != scene and s.osier.token == token for s in bpy.data.scenes)
    if is_shared or not TOKEN.fullmatch(token):
        scene.osier.token = uuid.uuid4().hex[:8]
    return os.path.join(bakes_folder(), f"{source_name(scene)}-{scene.osier.token}")
