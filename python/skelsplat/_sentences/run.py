"""What runs find in videos and files."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from skelsplat._optional import pip_line

if TYPE_CHECKING:
    from skelsplat.findings import Finding

_MOST_NAMES = 6  # that a sentence lists


def _layout_of_file(finding: Finding) -> str:
    """Return what the skeleton of a file has, and which pairs its names state."""
    pairs, (file,) = finding.numbers["pairs"], finding.subject.files
    count = f"{len(pairs)} left–right pair{'' if len(pairs) == 1 else 's'} by name"
    limbs = f"{finding.numbers['limbs']} limbs" if finding.numbers["limbs"] else "no limbs"
    shown = f" ({', '.join(pairs[:_MOST_NAMES])}{', …' if len(pairs) > _MOST_NAMES else ''})" if pairs else ""
    return f"The layout is that of {file}: {finding.numbers['joints']} joints, {limbs}, {count}{shown}."


SENTENCES: Mapping[str, str | Callable[[Finding], str]] = {
    "layout_of_file": _layout_of_file,
    "video_one_frame_late": "{files}: frames 0 to {last}, and the run has 1 to {last_of_run} of {cameras}: "
    "if its detector counts from 1, all is drawn one frame late; --first-frame 1 corrects that.",
    "video_padded": "{files}: {size[0]}×{size[1]}, but the camera {cameras} has "
    "{size_of_camera[0]}×{size_of_camera[1]}: drawn without scaling.",
    "video_rate_assumed": "--fps is not given, and neither the images nor the run state it: assuming {fps:g} "
    "frames per second.",
    "video_frames_missing": "{files}: {missing} of the frames {first} to {last} of the run cannot be read or "
    "are not in it; {drawn} were drawn.",
    "no_figures": f"Figures need skelsplat[viz]: {pip_line('viz')}",
}
