"""The files in the folder of a run by name, and how such a folder is told from any other."""

from __future__ import annotations

import json
import re
from pathlib import Path

POSES, CAMERAS, DETECTIONS, REPORT = "pose.npz", "cameras.json", "detections.npz", "report.json"
LAYOUT = "layout.toml"
"""The layout of a run, if it is not a built-in one."""
UNFINISHED = "unfinished"
"""Key of a report whose run still writes its files, or was stopped there."""

_START = 1024  # bytes; the versions come first


def is_run(folder: Path) -> bool:
    """Say whether a run wrote into this folder, whole or not, by how its report begins."""
    path = folder / REPORT
    try:
        if not path.is_file():
            return False
        with path.open("rb") as stream:
            start = stream.read(_START)
    except OSError:
        return False
    return b'"versions"' in start and b'"skelsplat"' in start


def files_of_run(folder: Path) -> list[str] | None:
    """Return the names of the files that the run which wrote into this folder lists; None without one."""
    return _listed(folder, "files")


def folders_of_run(folder: Path) -> list[str]:
    """Return the names of the people's folders that a run of several people lists."""
    return [name for name in _listed(folder, "folders") or [] if is_person(name)]


def is_person(name: str) -> bool:
    """Whether a folder has the name of one person's, ``person_0``."""
    return re.fullmatch(r"person_\d+", name) is not None


def _listed(folder: Path, key: str) -> list[str] | None:
    """Return the names under a key of a run's report; None without a run."""
    if not is_run(folder):
        return None
    try:
        report = json.loads((folder / REPORT).read_bytes())
    except (OSError, ValueError, RecursionError):
        return None
    versions = report.get("versions") if isinstance(report, dict) else None
    if not (isinstance(versions, dict) and "skelsplat" in versions and "settings" in report):
        return None
    listed = report.get(key)
    return [name for name in listed if isinstance(name, str)] if isinstance(listed, list) else []
