"""Warnings of `skelsplat.refine`, and of the readers of calibrations and poses."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from skelsplat.findings import Finding


def _unit_wrong(finding: Finding) -> str:
    numbers = finding.numbers
    metres = numbers["metres"]
    far = f"{1e3 * metres:.3g} mm" if metres < 1 else f"{metres:.{0 if metres >= 100 else 2}f} m"
    read = f"if it is {numbers['unit']}, the cameras are {far} apart"
    return f"{finding.subject.files[0]}: unit: {read}; {numbers['hint']}"


def _trc_rate(finding: Finding) -> str:
    rate = finding.numbers["frame_rate"]
    given = (
        f"it is {rate:g} by the times of the rows, which decide"
        if rate
        else "the times of the rows give no rate either"
    )
    return (
        f"{finding.subject.files[0]}: the header (line 3) states {finding.numbers['stated']:g} frames per "
        f"second; {given}."
    )


SENTENCES: Mapping[str, str | Callable[[Finding], str]] = {
    "unit_wrong": _unit_wrong,
    "lens_assumed": "{files}: no distortions for {cameras}: assumed to have no lens distortion.",
    "view_rotated": (
        "{files}: viewrotation: images of {cameras} were rotated for display; the calibration is for images "
        "as the sensor records them, so the detections must come from unrotated images."
    ),
    "lens_approximated": (
        "{files}: camera {cameras}: OpenCV's lens model follows Vicon's to {error_px:.2g} px at worst "
        "(towards the corners of the image)."
    ),
    "focal_in_pixels": (
        "{files}: focal length and centre of {cameras} are in px here, not in 1/64 px as Qualisys writes "
        "them; read as px."
    ),
    "crop_applied": (
        "{files}: offset: videos of {cameras} are cropped; detections are taken to be in pixels of the crop."
    ),
    "skew_approximated": (
        "{files}: skew of {cameras}: not supported; the cameras turned by half of it agree to {error_px:.2g} "
        "px at worst (towards the corners of the image)."
    ),
    "axes_unknown": (
        "{files}: a TRC file does not state which axis is up. If y is up in it already, --y-up turns it "
        "again."
    ),
    "trc_frames": "{files}: the header (line 3) states {stated} frames, but {rows} follow. All are read.",
    "trc_rate": _trc_rate,
    "axes_turned": "{files}: y is up in it already (POINT:Y_SCREEN); --y-up turns its axes once more.",
}
