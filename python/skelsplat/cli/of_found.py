"""Commands about what the folder of a recording holds, as they are typed, and the same in Python."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from skelsplat.cli.batch import job_of
from skelsplat.cli.rows import NAME_OR_PATH, texts_in, typed
from skelsplat.cli.settings import OPTIONS, SHARED
from skelsplat.exceptions import SkelSplatError
from skelsplat.run.found import Found, output_of

CAMERAS, PAGE_OF_CAMERAS, KEYPOINTS = "Calib-from-people.toml", "calibration.html", "pose"
"""What calibrate and detect write into the folder of a recording."""
Given = Mapping[str, Mapping[str, Any]]
"""By command and name, the texts of settings, as `typed` takes them."""


def words_of(command: str, found: Found, given: Given) -> list[str]:
    """Return a command, without `skelsplat`; paths are relative to the folder."""
    own, out = given[command], output_of(found.folder)
    if command == "detect" and find_spec("mediapipe") is None and find_spec("rtmlib") is not None:
        own = {"backend": "rtmlib", **own}
    if command == "calibrate":
        own = {**{name: given["refine"].get(name) for name in SHARED}, **own}
    files = {
        "detect": (found.videos, "-o", KEYPOINTS),
        "calibrate": (found.detections, "-o", CAMERAS, "--force", "--report", PAGE_OF_CAMERAS),
        "refine": (found.calibration, found.detections, "-o", out),
        "overlay": (out, found.videos or "--plain"),
    }
    return [command, *files[command], *typed(OPTIONS[command], own)]


def paths_in(given: Given) -> list[str]:
    """Return the settings that are paths, or may be."""
    return [
        texts[row.name]
        for command, texts in given.items()
        for row in OPTIONS[command]
        if (row.kind is Path or NAME_OR_PATH in row.marks) and texts.get(row.name)
    ]


def after_calibrate(commands: Sequence[str]) -> dict[str, Any]:
    """Return the settings of refine that go with found cameras, of the commands that calibrate names."""
    found: dict[str, Any] = {"calibration": CAMERAS} if commands else {}
    for command in commands:
        found |= texts_in(OPTIONS["refine"], shlex.split(command))
    return found


def lines_of(found: Found, given: Given, done: Sequence[str]) -> dict[str, str]:
    """Return the commands that were ``done`` and that which refines, and Python that does; by name."""
    last, python = [], ""
    if found.ready:
        try:
            words = words_of("refine", found, given)
            python, last = job_of(words[1:]).python, [shlex.join(["skelsplat", *words])]
        except SkelSplatError as error:
            last = [f"# {error}"]
    # Each where it was done last: the results are those of the last one.
    every = list(dict.fromkeys(reversed([*done, *last])))
    commands = [f"cd {shlex.quote(str(found.folder))}", *reversed(every)] if every else []
    lines = {"the commands": "\n".join(commands), "the Python lines": python}
    return {name: text for name, text in lines.items() if text}
