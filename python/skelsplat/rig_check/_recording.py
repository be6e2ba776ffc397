"""Whether calibration and detections belong together at all."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from skelsplat.rig_check._findings import Finding
from skelsplat.rig_check._scene import named

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skelsplat.rig_check._scene import Scene

# A camera that was knocked turns by less than this; one set up anew is further off.
_FAR_DEG, _FAR_MM = 2.5, 150.0
# Part of the diagonal, 42 px of 1000 by 1000: two and a half times what poor detections are off.
_FAR_OFF = 0.03
_LEAST_FRAMES = 5


def check_recording(causes: Sequence[Finding], mended: Scene) -> Finding | None:
    """Doubt the whole recording if half of the cameras or more would have to stand elsewhere.

    Counted are cameras that only agree when far turned or moved, and those that agree with nothing even in
    the scene in which all that was found is put right.
    """
    if mended.views < 3 or len(mended.judged) < _LEAST_FRAMES:
        return None
    names = named(mended.cameras)
    moved = {name for finding in causes if _is_far(finding) for name in finding.cameras}
    limits = _FAR_OFF * np.array([np.hypot(*camera.size) for camera in mended.cameras])
    lost = {name for name, far in zip(names, mended.left_out > limits, strict=True) if far}
    wrong = tuple(name for name in names if name in moved | lost)
    if 2 * len(wrong) < len(names):
        return None
    text = (
        "Calibration and detections probably do not belong together (another recording, another rig, or "
        f"cameras that were set up anew): {len(wrong)} of {len(names)} cameras ({', '.join(wrong)}) do not "
        "stand where the calibration says. Which ones are right cannot be told."
    )
    return Finding("recording", wrong, text, {"cameras": len(wrong), "of": len(names)})


def _is_far(finding: Finding) -> bool:
    if finding.kind not in ("turned", "moved"):
        return False
    return bool(finding.numbers["degrees"] >= _FAR_DEG or finding.numbers["mm"] >= _FAR_MM)
