"""What the verification of a data set finds: field, expected and actual, as in the `DatasetError` of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from skelsplat.findings import Finding

_MOST_PAIRS = 3

_PARTS: Mapping[str, tuple[str, str, str]] = {
    "dataset_truth_unit": (
        "truth",
        "joints in {unit}",
        "a body of {size:.3g} {unit} (plausible in {likely_unit})",
    ),
    "dataset_truth_size": ("truth", "joints in {unit}", "a body of {size:.3g} {unit}"),
    "dataset_camera_unit": (
        "cameras",
        "translations in {unit}",
        "cameras that fit if their translations are multiplied by {factor:g}",
    ),
    "dataset_sides": (
        "left and right",
        "the same sides in the truth and the detections",
        "exchanged sides: {given_px:.1f} px from the truth as given, {exchanged_px:.1f} px exchanged",
    ),
    "dataset_joint_order": (
        "joints",
        "the order of {layout} in the truth and the detections",
        "another order: {listed_pairs}",
    ),
    "dataset_view_of_another_camera": (
        "camera {cameras}",
        "detections of this camera",
        "{given_px:.1f} px from the truth, and {other_px:.1f} px in camera {other}",
    ),
    "dataset_view_sides": (
        "camera {cameras}",
        "left and right as in the other views",
        "{given_px:.1f} px as given, {exchanged_px:.1f} px with sides exchanged",
    ),
    "dataset_view_far": (
        "camera {cameras}",
        "detections near the truth",
        "errors of up to {quarter_px:.1f} px in the best quarter of them",
    ),
    "dataset_lens_tangential": (
        "distortion of {cameras}",
        "the lens of the detections",
        "p1 and p2 exchanged",
    ),
    "dataset_lens_none": (
        "distortion of {cameras}",
        "the lens of the detections",
        "detections without distortion (undistorted, or made with K alone)",
    ),
}


def parts(finding: Finding) -> tuple[str, str, str]:
    """Return field, expected and actual of a finding."""
    values = {name: ", ".join(map(str, each)) for name, each in asdict(finding.subject).items()}
    pairs = [f"{joint} lies on {other}" for joint, other in finding.numbers.get("pairs", ())]
    listed = f"{', '.join(pairs[:_MOST_PAIRS])}{_more(len(pairs) - _MOST_PAIRS)}"
    field, expected, actual = (
        form.format(**values, **finding.numbers, listed_pairs=listed) for form in _PARTS[finding.kind]
    )
    takes = finding.subject.takes
    return field, expected, f"{actual} in {takes[0]}{_more(len(takes) - 1)}" if takes else actual


def _more(count: int) -> str:
    return f" and {count} more" if count > 0 else ""


def _sentence(finding: Finding) -> str:
    field, expected, actual = parts(finding)
    return f"{field}: expected {expected}, got {actual}"


SENTENCES: Mapping[str, str | Callable[[Finding], str]] = dict.fromkeys(_PARTS, _sentence)
