"""Writing simulated data sets; ``docs/synthetic-data.md`` describes the layout, `synthetic` reads it."""

from __future__ import annotations

import json
import secrets
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from skelsplat import io
from skelsplat._skelsplat import Camera
from skelsplat.cameras import CameraRig
from skelsplat.exceptions import DatasetError

if TYPE_CHECKING:
    from skelsplat.synthetic.sets import Recording, RecordingSet

FORMAT, FORMAT_VERSION = "skelsplat-simulated", 1
INDEX = "dataset.json"

Array = NDArray[Any]


def write_simulated(root: Path, data: RecordingSet, *, openpose: bool = False, force: bool = False) -> None:
    """Write a simulated data set to the folder `root`, whole or not at all.

    Parameters
    ----------
    root : Path
        Must not exist, or be empty.
    data : RecordingSet
        As `skelsplat.synthetic.simulate_set` makes it.
    openpose : bool
        Write the detections as OpenPose JSON too, one file per frame and camera.
    force : bool
        Replace a simulated data set that is there. Anything else is never replaced.

    Raises
    ------
    DatasetError
        If there is something at `root`, or it cannot be written.
    """
    _check_free(root, force=force)
    temporary = root.with_name(f".{root.name}.{secrets.token_hex(6)}.tmp")
    try:
        temporary.mkdir(parents=True)
        _write_rigs(temporary / "cameras", data.rigs)
        for recording in data.recordings:
            _write_take(temporary / "takes" / recording.key, recording)
            if openpose:
                _write_openpose(temporary / "takes" / recording.key, recording, data.rigs[recording.rig_name])
        # The index comes last: without it a folder is no data set.
        text = json.dumps(_index(data), indent=1, ensure_ascii=False)
        (temporary / INDEX).write_text(text + "\n", encoding="utf-8")
        _move(temporary, root)
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise DatasetError(root, "output", "a folder that can be written", reason) from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _check_free(root: Path, *, force: bool) -> None:
    if not root.exists():
        return
    if not root.is_dir():
        raise DatasetError(root, "output", "a folder", "a file")
    if not any(root.iterdir()):
        return
    if not force:
        raise DatasetError(root, "output", "no folder or an empty one (--force replaces)", "files in it")
    try:
        known = json.loads((root / INDEX).read_text(encoding="utf-8"))["format"] == FORMAT
    except (OSError, ValueError, KeyError, TypeError):
        known = False
    if not known:
        raise DatasetError(root, "output", "a simulated data set to replace", "files of something else")


def _move(temporary: Path, root: Path) -> None:
    """Put the finished folder in its place; an older one is out of the way before, and removed after."""
    if not root.exists():
        temporary.replace(root)
        return
    old = root.with_name(f".{root.name}.{secrets.token_hex(6)}.old")
    root.replace(old)
    temporary.replace(root)
    shutil.rmtree(old)


def _index(data: RecordingSet) -> dict[str, Any]:
    detectors = sorted({name for recording in data.recordings for name in recording.detections})
    return {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "name": data.name,
        "simulated": True,
        "unit": next(iter(data.rigs.values())).unit,
        "layout": data.layout.name,
        "joints": list(data.layout.joints),
        "detectors": detectors,
        "cameras": list(data.rigs),
        "takes": [
            {
                "key": recording.key,
                "subject": recording.subject,
                "action": recording.action,
                "cameras": recording.rig_name,
                "frames": len(recording.frames),
            }
            for recording in data.recordings
        ],
        "parameters": data.parameters,
    }


def _write_rigs(folder: Path, rigs: Mapping[str, CameraRig]) -> None:
    folder.mkdir()
    for name, rig in rigs.items():
        io.write_calibration(folder / f"{name}.toml", rig)
        document = {"unit": rig.unit, "cameras": [_camera(camera) for camera in rig]}
        (folder / f"{name}.json").write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")


def _camera(camera: Camera) -> dict[str, Any]:
    return {
        "name": camera.name,
        "size": list(camera.size),
        "K": camera.K.tolist(),
        "R": camera.R.tolist(),
        "t": camera.t.tolist(),
        "distortion": [] if camera.distortion is None else camera.distortion.tolist(),
    }


def _write_take(folder: Path, recording: Recording) -> None:
    folder.mkdir(parents=True)
    truth: dict[str, Array] = {"poses": recording.truth, "boxes": recording.boxes}
    if recording.visible is not None:
        truth["visible"] = recording.visible
    parts: dict[str, dict[str, Array]] = {
        "truth": truth,
        "monocular_simulated": {"poses": recording.monocular},
    }
    for name, detections in recording.detections.items():
        parts[f"detections_simulated_{name}"] = {"detections": detections}
    for stem, arrays in parts.items():
        np.savez(folder / f"{stem}.npz", allow_pickle=False, frames=recording.frames, **arrays)


def _write_openpose(folder: Path, recording: Recording, rig: CameraRig) -> None:
    """Write ``openpose_simulated_DETECTOR/CAMERA/FRAME_keypoints.json``; missing joints are 0, 0, 0."""
    for name, detections in recording.detections.items():
        for view, camera in enumerate(rig.names):
            target = folder / f"openpose_simulated_{name}" / camera
            target.mkdir(parents=True)
            rows = np.nan_to_num(detections[:, view]).round(3).reshape(len(recording.frames), -1).tolist()
            for frame, row in zip(recording.frames.tolist(), rows, strict=True):
                person = {"person_id": [-1], "pose_keypoints_2d": row}
                text = json.dumps({"version": 1.3, "people": [person]})
                (target / f"{frame:012d}_keypoints.json").write_text(text, encoding="utf-8")
