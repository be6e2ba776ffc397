"""The files in the folder of a run by name, and how such a folder is told from any other."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

POSES, CAMERAS, DETECTIONS, REPORT = "pose.npz", "cameras.json", "detections.npz", "report.json"
UNFINISHED = "unfinished"
"""Key of a report whose run still writes its files, or was stopped there."""


def is_run(folder: Path) -> bool:
    """Say whether a run wrote into this folder, whole or not."""
    return files_of_run(folder) is not None


def files_of_run(folder: Path) -> list[str] | None:
    """Return the names of the files that the run which wrote into this folder lists; None without one."""
    try:
        report = json.loads((folder / REPORT).read_bytes())
    except (OSError, ValueError, RecursionError):
        return None
    versions = report.get("versions") if isinstance(report, dict) else None
    if not (isinstance(versions, dict) and "skelsplat" in versions and "settings" in report):
        return None
    listed = report.get("files")
    return [name for name in listed if isinstance(name, str)] if isinstance(listed, list) else []
