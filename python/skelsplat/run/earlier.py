"""How an earlier run was asked for, from its report."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from skelsplat.io.poses import POSE_FORMATS

_STATED = ("unit", "layout", "person", "sequence", "order", "mapping", "adjust_cameras", "move")


def options_of(report: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of the `skelsplat.run.Job` that a report states, but for files and the method."""
    made = report["input"]
    found = {name: made.get(name) for name in _STATED}
    found["offsets"] = {camera: frames for camera, frames in made.get("offsets", {}).items() if frames}
    found["without"] = tuple(made.get("without", ()))
    found["frames"] = made.get("frame_mode")
    found["fps"] = made.get("frame_rates_hz") or made.get("frame_rate_hz")
    if "people" in report:
        found |= {"people": made["people"], "person": None}
    # files of several people are listed by the report of each
    names = [name.partition(".")[2] for name in report["files"] if name.startswith("pose.")]
    found["write"] = tuple(kind for kind in names if kind in POSE_FORMATS and kind != "npz")
    return {name: value for name, value in found.items() if value not in (None, "", False, (), {})}
