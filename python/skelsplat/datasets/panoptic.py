"""CMU Panoptic Studio: sequences with one person, HD cameras, 19 joints.

Calibration and truth are those of the panoptic-toolbox, in cm; everything is given in mm. The world's y axis
points down, as in the source.

- ``calibration_SEQ.json`` in ``SEQ/``, in ``cameras/`` or in the root itself;
- truth ``3d_gt/S0/SEQ/poses_filtered_N.npz`` (of the method's authors, N views), else
  ``SEQ/hdPose3d_stage1_coco19/body3DScene_%08d.json``;
- detections ``2d_DETECTOR/S0/SEQ[/CAMERA]/poses_filtered_N.npz`` or ``poses.npz``, or the same in the folder
  `detections`: ``poses2d`` (T, M, 19, 2 or 3), and with ``frames`` (T,) the frame numbers;
- monocular poses ``initial_guess/NAME/S0/SEQ[/CAMERA]/poses_filtered_N.npz`` or ``poses.npz``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from skelsplat._arrays import Array, Index
from skelsplat.cameras import MM_PER_UNIT
from skelsplat.datasets._detections import detections_of, poses_file, read_truth, read_world, with_detections
from skelsplat.datasets._files import Survey, read_cameras
from skelsplat.datasets._model import Dataset, Take
from skelsplat.exceptions import DatasetError, InvalidInputError, one_of
from skelsplat.io import convert_unit
from skelsplat.io._files import frame_number, json_document
from skelsplat.layouts import PANOPTIC19

SEQUENCES = ("171204_pose5", "171204_pose6")
CAMERAS = (1, 2, 10, 13, 3, 23, 19, 30)
"""HD cameras in the order in which the experiments add them: the first four, then one by one."""

_MM = 10.0
_HD_FPS = 29.97
# A joint with less confidence is no measurement; the toolbox writes −1 where there is none at all.
_LEAST_CONFIDENCE = 0.1


def read(
    root: Path,
    survey: Survey,
    *,
    detector: str | None = None,
    detections: Path | str | None = None,
    views: int | Sequence[int] = 4,
    sequences: Sequence[str] = SEQUENCES,
    truth_unit: str = "cm",
    person: int | None = None,
    monocular: str | None = None,
) -> Dataset:
    """Read sequences of CMU Panoptic.

    `views` are the first so many of `CAMERAS`, or numbers of HD cameras. `truth_unit` is that of the truth in
    ``3d_gt``; that of the toolbox is always cm. `person` is the id of the body if there are several.
    """
    chosen = _cameras(views)
    one_of("truth_unit", truth_unit, MM_PER_UNIT)
    source, name = detections_of(survey, root, detector, detections, "metrabs")
    stems = (f"poses_filtered_{len(chosen)}", "poses")

    def take(sequence: str) -> Take:
        file = f"calibration_{sequence}.json"
        places = [folder / file for folder in (root / sequence, root / "cameras", root)]
        path = survey.find(places, f"calibration of {sequence}")
        cameras = read_cameras(path, "panoptic", [f"00_{n:02d}" for n in chosen], camera_type="hd")
        folder = root / "3d_gt" / "S0" / sequence
        if poses_file(folder, stems) is None:
            own = survey.find([root / sequence / "hdPose3d_stage1_coco19"], f"truth of {sequence}")
            frames, truth = _read_bodies(own, person)
        else:
            given, truth, numbered = read_truth(survey, folder, PANOPTIC19.n_joints, stems)
            frames = np.arange(len(truth)) if numbered is None else numbered
            truth, own = MM_PER_UNIT[truth_unit] * truth, given.path
        files = {"cameras": path, "truth": own}
        rig = convert_unit(cameras, "mm")
        one = Take(f"S0/{sequence}", "S0", sequence, rig, frames, truth, fps=_HD_FPS, files=files)
        if source is None:
            return one
        guess = None if monocular is None else root / "initial_guess" / monocular / "S0" / sequence
        return _with_detections(survey, one, source / sequence, guess, stems)

    takes = tuple(map(take, sequences))
    words = f"CMU Panoptic, HD cameras {', '.join(map(str, chosen))}, detections: {name or 'none'}"
    return Dataset("panoptic", PANOPTIC19, takes, detector=name, source=words, notes=tuple(survey.notes))


def _cameras(views: int | Sequence[int]) -> tuple[int, ...]:
    chosen = CAMERAS[: max(views, 0)] if isinstance(views, int) else tuple(views)
    if not chosen or len(set(chosen)) < len(chosen) or (isinstance(views, int) and views > len(CAMERAS)):
        expected = f"1 to {len(CAMERAS)}, or different numbers of cameras"
        raise InvalidInputError(f"views: expected {expected}, got {views!r}")
    return chosen


def _with_detections(
    survey: Survey, take: Take, folder: Path, guess: Path | None, stems: Sequence[str]
) -> Take:
    """Return the frames of a take in which every view has a detection."""
    found = with_detections(survey, take, PANOPTIC19, folder, stems)
    if guess is not None:
        found = replace(found, monocular=read_world(survey, guess, take, len(found), "world poses", stems))
    detected = np.any(np.asarray(found.detections)[..., 2] > 0, axis=2)
    found = found.select(np.all(detected, axis=1))
    if lost := len(take) - len(found):
        survey.notes.append(f"{take.key}: {lost} of {len(take)} frames left out, not detected in every view")
    return found


def _read_bodies(folder: Path, person: int | None) -> tuple[Index, Array]:
    """Return the frames (T,) with the person (None: the only one) and joints (T, 19, 3) mm, or NaN."""
    bodies: dict[int, dict[int, Array]] = {}
    for path in sorted(folder.glob("body3DScene_*.json")):
        number = path.stem.removeprefix("body3DScene_")
        if not number.isdecimal():
            raise DatasetError(path, "file name", "body3DScene_ and a frame number", path.name)
        bodies[frame_number(path, "file name", number)] = _bodies(path)
    seen = sorted({name for there in bodies.values() for name in there})
    if person is None and len(seen) > 1:
        raise DatasetError(folder, "bodies", "one person (choose one by id)", f"ids {seen}")
    chosen = person if person is not None else next(iter(seen), -1)
    frames = sorted(frame for frame, there in bodies.items() if chosen in there)
    if not frames:
        expected = "body3DScene_%08d.json" if person is None else f"person {person}"
        raise DatasetError(folder, "bodies", expected, f"{len(bodies)} files, ids {seen}")
    return np.array(frames, dtype=np.int64), np.stack([bodies[frame][chosen] for frame in frames])


def _bodies(path: Path) -> dict[int, Array]:
    found = {}
    for body in json_document(path, "bodies")["bodies"].entries():
        joints = body["joints19"].array_of(4 * PANOPTIC19.n_joints).reshape(-1, 4)  # x, y, z, confidence
        measured = joints[:, 3:] > _LEAST_CONFIDENCE
        with np.errstate(over="ignore"):  # refused with the take
            found[int(body["id"].number())] = np.where(measured, _MM * joints[:, :3], np.nan)
    return found
