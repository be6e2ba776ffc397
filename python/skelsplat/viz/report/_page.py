"""The page of one person's run."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

from skelsplat._arrays import Array
from skelsplat._atomic import atomic_write_text
from skelsplat.viz import _style
from skelsplat.viz.report import _parts
from skelsplat.viz.report._parts import PageData, Table, TimeLine, TimeLines
from skelsplat.viz.report._scene import CameraShapes, Sequence3D, as_text, frames_to_show, pack_scene

# One program in several files, in this order.
_PROGRAMS = ("decode.js", "body.js", "view.js", "charts.js", "heat.js", "panels.js", "player.js")


_ALONE_CHOICE = '<label><input type="radio" name="pose" value="alone"> frame by frame</label>'
_SIDES_KEY = " ".join(f'<span class="{side}">{side}</span>' for side in _style.SIDES)
_FOLLOW = '<label><input type="checkbox" id="follow"> follow</label>'


@dataclass(frozen=True)
class ReportData(PageData):
    """A whole report."""

    sequence: Sequence3D
    shapes: CameraShapes
    cameras: Table
    joints: Table
    # (M, N) by camera and joint: median error in px, and the part of the detections that is rejected;
    # NaN where a camera has no detection of a joint that is used
    errors_px: Array
    rejected: Array
    lines: Sequence[TimeLine | TimeLines]
    # (joint, joint, length, standard error) of the bones of a solution over time, in mm; NaN where unknown
    bones: Sequence[tuple[int, int, float, float]] = ()


def write_report(path: str | os.PathLike[str], data: ReportData) -> Path:
    """Write a report as one HTML file that needs no network, whole or not at all.

    plotly.js is 4.8 MB of it; a sequence takes 33 bytes per joint and frame, solved over time 44, and a curve
    5 bytes per frame, or 11 with a band.
    One of more than `_scene.MOST_POSITIONS` is thinned out, and the page says so.
    """
    atomic_write_text(path, build_page(data))
    return Path(path)


def build_page(data: ReportData) -> str:
    """Return the page's text."""
    sequence = data.sequence
    places, every = frames_to_show(sequence.frames, len(sequence.joint_names), data.wanted)
    bones = [{"ends": [a, b], "length_mm": length, "sigma_mm": sigma} for a, b, length, sigma in data.bones]
    content = {
        "scene": pack_scene(sequence, data.shapes, places),
        "heat": {
            "cameras": list(data.shapes.names),
            "joints": list(sequence.joint_names),
            "errors": as_text(data.errors_px, "<f4"),
            "rejected": as_text(data.rejected, "<f4"),
        },
        "lines": [_parts.packed_line(line, places) for line in data.lines],
        "bones": None if sequence.alone is None else bones,
        "colours": {"left": _style.LEFT, "right": _style.RIGHT},
    }
    thinned = _parts.thinned(len(sequence.frames), len(places), every)
    return _parts.assemble(
        _PROGRAMS,
        content,
        data,
        thinned,
        warnings=_parts.bullets(data.warnings) or "<p>None. Frames with a problem are listed below.</p>",
        warnings_kind="loud" if data.warnings else "quiet",
        player=_player(sequence),
        sections=_parts.fill(
            "person.html",
            cameras=_parts.table(data.cameras),
            joints=_parts.table(data.joints),
            meanings=_parts.meanings(data.joints),
            refined=sequence.refined_name,
            grey=escape(sequence.grey),
            in_time="" if sequence.alone is None else _parts.resource("in_time.html"),
        ),
    )


def _player(sequence: Sequence3D) -> str:
    return _parts.fill(
        "player.html",
        start=escape(sequence.start_name),
        refined=sequence.refined_name,
        grey=escape(sequence.grey),
        alone="" if sequence.alone is None else _ALONE_CHOICE,
        ellipsoids="checked",
        follow=_FOLLOW,
        whom="person",
        groups=_SIDES_KEY,
        walked='<span class="walked">path on the floor</span>',
        hollow=_parts.hollow_key(sequence.status),
    )
