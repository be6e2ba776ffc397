"""The options of commands that are settings, as texts: by command and name, as a page has them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from itertools import chain
from typing import Any

from skelsplat.cli import calibrate, detect, options, pictures
from skelsplat.cli.batch import job_of, typed_for_refine
from skelsplat.cli.rows import Option, typed
from skelsplat.exceptions import InvalidInputError

_OF_FILES = {"calibration", "detections", "output", "videos", "run", "report", "force", "overwrite", "plain"}
OPTIONS: dict[str, tuple[Option, ...]] = {
    command: tuple(row for row in rows if row.name not in _OF_FILES)
    for command, rows in {
        "refine": options.JOB,
        "calibrate": calibrate.OPTIONS,
        "detect": detect.OPTIONS,
        "overlay": pictures.OVERLAY_OPTIONS,
    }.items()
}
"""By command, the options that are settings: all but those that say which files."""
SHARED = ("layout", "frames", "format", "mapping", "sequence", "fps", "size")
"""Options of calibrate that are those of refine, and are set once."""
_OF_TERMINAL = r" \(skelsplat [^)]*\)| skelsplat [a-z-]+ [^.]*\."  # in a help
_TITLES = {row.flag: f"“{row.title}”" for row in chain(*OPTIONS.values())}


def put(given: dict[str, Any], name: str, value: Any) -> None:
    """Set the text of an option among texts that `typed` takes; nothing takes it back."""
    if value in (None, "", False, []):
        given.pop(name, None)
    else:
        given[name] = value


def wrong(command: str, row: Option, value: Any, given: Mapping[str, Any]) -> str:
    """Return in a sentence what is wrong with the value of a setting, with those ``given``; else nothing."""
    if not value:
        return ""
    found = "" if row.kind is bool else row.wrong(value)
    if not found and command == "refine":
        try:
            job_of([".", ".", "-o", ".", *typed(OPTIONS[command], {**given, row.name: value})])
        except InvalidInputError as error:
            of, _, words = str(error).partition(": ")
            found = f"{words[:1].upper()}{words[1:]}." if of == row.flag else ""
    return worded(found)


def required(row: Option, value: Any, given: Mapping[str, Any]) -> list[Option]:
    """Return the setting of refine without which a value of another has no effect, unless it is given."""
    words = wrong("refine", row, value, given)
    return [one for one in OPTIONS["refine"] if words == worded(f"Requires {one.flag}.")]


def are_wrong(command: str, given: Mapping[str, Any]) -> bool:
    """Whether something is wrong with one of the settings of a command."""
    return any(wrong(command, row, given.get(row.name), given) for row in OPTIONS[command])


def worded(text: str) -> str:
    """Return a sentence of the package or of a command with the titles of settings."""
    return re.sub(r"--[a-z][a-z-]*", lambda flag: _TITLES.get(flag[0], flag[0]), typed_for_refine(text))


def from_field(row: Option, value: Any) -> Any:
    """Return the text of a setting, or the list of a repeatable one, from what its field on a page has."""
    if not isinstance(value, str):
        return ",".join(value) if row.name == "write" else value
    return [one for part in value.split(",") if (one := part.strip())] if row.many else value.strip()


def help_of(row: Option) -> str:
    """Return the help of an option in the words of a page."""
    return worded(re.sub(_OF_TERMINAL, "", row.help).replace("Repeatable.", "Several with commas."))


def reading_of(given: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Return how files are read with settings, as `look` takes it; `InvalidInputError` if one is wrong."""
    texts = given["refine"]
    job = job_of([".", ".", "-o", ".", *typed(OPTIONS["refine"], texts)])
    chosen = {name: texts.get(name) for name in ("calibration", "detections")}
    return {**vars(job), **chosen}
