"""Every way to write a format of detections, and what of the detections it keeps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import detection_files as files


@dataclass(frozen=True)
class Case:
    """A way to write a format, and what of the detections it keeps."""

    write: Callable[..., Path]
    format: str
    people: bool = True  # more than one
    confidence: bool = True
    frames: bool = True  # their numbers
    precision: type = np.float64
    layout: str = "h36m17"
    order: str | None = None  # how cameras are matched where the file does not name them


_ALONE = {"people": False, "confidence": False, "frames": False}
CASES = {
    "openpose": Case(files.openpose, "openpose"),
    "easymocap": Case(files.easymocap, "easymocap"),
    "mmpose": Case(files.mmpose, "mmpose"),
    "alphapose": Case(files.alphapose, "alphapose"),
    "coco": Case(files.coco, "coco"),
    "rtmlib_frames": Case(files.rtmlib_frames, "rtmlib"),
    "rtmlib_pairs": Case(files.rtmlib_pairs, "rtmlib"),
    "rtmlib_cameras": Case(files.rtmlib_cameras, "rtmlib"),
    "metrabs": Case(files.metrabs, "metrabs", confidence=False),
    "metrabs_ragged": Case(files.metrabs_ragged, "metrabs", confidence=False),
    "deeplabcut": Case(files.deeplabcut, "deeplabcut", people=False),
    "deeplabcut_multi": Case(files.deeplabcut_multi, "deeplabcut"),
    "deeplabcut_tracks": Case(files.deeplabcut_tracks, "deeplabcut"),
    "deeplabcut_csv": Case(files.deeplabcut_csv, "deeplabcut_csv", people=False),
    "deeplabcut_csv_multi": Case(files.deeplabcut_csv_multi, "deeplabcut_csv"),
    "sleap": Case(files.sleap, "sleap", frames=False),
    "sleap_without_scores": Case(files.sleap_without_scores, "sleap", confidence=False, frames=False),
    "sleap_unturned": Case(files.sleap_unturned, "sleap", frames=False),
    "sleap_standard": Case(files.sleap_standard, "sleap", frames=False),
    "sleap_csv": Case(files.sleap_csv, "sleap_csv"),
    "sleap_slp": Case(files.sleap_slp, "sleap_slp"),
    "sleap_slp_cameras": Case(files.sleap_slp_cameras, "sleap_slp"),
    "ndx_pose": Case(files.ndx_pose, "ndx_pose", people=False),
    "ndx_pose_sleap": Case(files.ndx_pose_sleap, "ndx_pose"),
    "caliscope": Case(files.caliscope, "caliscope", confidence=False, order="sorted"),
    "caliscope_ports": Case(
        files.caliscope_ports, "caliscope", people=False, confidence=False, order="sorted"
    ),
    "freemocap": Case(files.freemocap, "freemocap", layout="coco17", order="sorted", **_ALONE),
    "videopose3d": Case(files.videopose3d, "videopose3d", precision=np.float32, order="sorted", **_ALONE),
    "videopose3d_custom": Case(
        files.videopose3d_custom, "videopose3d", precision=np.float32, layout="coco17", **_ALONE
    ),
    "wide_csv": Case(files.wide_csv, "wide_csv", people=False),
    "npz": Case(files.npz, "npz"),
    "npz_cameras": Case(files.npz_cameras, "npz"),
    "csv": Case(files.plain_csv, "csv"),
    "csv_cameras": Case(files.plain_csv_cameras, "csv"),
}
