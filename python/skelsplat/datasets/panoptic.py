"""CMU Panoptic Studio: sequences with one person, HD cameras, 19 joints.

Calibration and truth are those of the panoptic-toolbox, in cm; everything is given in mm. The world's y axis
points down, as in the source.

- ``calibration_SEQ.json`` in ``SEQ/``, in ``cameras/`` or in the root itself;
- truth ``SEQ/hdPose3d_stage1_coco19/body3DScene_%08d.json`` (format ``"toolbox"``) or
  ``3d_gt/S0/SEQ/poses_filtered_N.npz`` (format ``"skelsplat"``, N views);
- detections ``2d_DETECTOR/S0/SEQ[/CAMERA]/poses_filtered_N.npz`` or ``poses.npz``, or ``SEQ[/CAMERA]`` in the
  folder `detections`: ``poses2d`` (T, M, 19, 2 or 3), and with ``frames`` (T,) the frame numbers;
- monocular poses ``initial_guess/NAME/S0/SEQ[/CAMERA]/poses_filtered_N.npz`` or ``poses.npz``.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from skelsplat._arrays import Array, Index, Mask
from skelsplat.cameras import MM_PER_UNIT
from skelsplat.datasets._detections import (
    Wanted,
    detections_of,
    poses_file,
    read_apart,
    read_truth,
    read_world,
)
from skelsplat.datasets._files import Survey, load_json, read_cameras
from skelsplat.datasets._model import Dataset, Take
from skelsplat.exceptions import DatasetError, InvalidInputError, one_of
from skelsplat.io import convert_unit
from skelsplat.io._files import frame_number
from skelsplat.layouts import PANOPTIC19

SEQUENCES = ("171204_pose5", "171204_pose6")
CAMERAS = (1, 2, 10, 13, 3, 23, 19, 30)
"""HD cameras in the order in which the experiments add them: the first four, then one by one."""

_TRUTHS = {"toolbox": "hdPose3d_stage1_coco19", "skelsplat": "3d_gt"}
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
    format: str | None = None,
    truth_unit: str = "cm",
    person: int | None = None,
    monocular: str | None = None,
) -> Dataset:
    """Read sequences of CMU Panoptic.

    Parameters
    ----------
    views : int or sequence of int
        The first so many of `CAMERAS`, or numbers of HD cameras.
    sequences : sequence of str
    format : {"toolbox", "skelsplat"} or None
        Where the truth is.
    truth_unit : {"cm", "mm", "m"}
        Unit of the truth in format ``"skelsplat"``; that of the toolbox is always cm.
    person : int or None
        Id of the body to take where there are several.
    """
    chosen = _cameras(views)
    one_of("format", format, (None, *_TRUTHS))
    one_of("truth_unit", truth_unit, MM_PER_UNIT)
    survey.format = format or ""
    source, name = detections_of(survey, root, detector, detections, "metrabs")

    def take(sequence: str) -> Take:
        path = survey.find(_calibrations(root, sequence), f"calibration of {sequence}")
        rig = convert_unit(
            read_cameras(path, "panoptic", [camera_name(n) for n in chosen], camera_type="hd"), "mm"
        )
        frames, truth, own = _truth(survey, root, sequence, (len(rig), format, truth_unit, person))
        files = {"cameras": path, "truth": own}
        one = Take(f"S0/{sequence}", "S0", sequence, rig, frames, truth, fps=_HD_FPS, files=files)
        guess = None if monocular is None else root / "initial_guess" / monocular / "S0" / sequence
        if source is None:
            return one
        return _with_detections(survey, one, source, guess, filtered=detections is None)

    takes = tuple(survey.each(take, sequences))
    words = f"CMU Panoptic, HD cameras {', '.join(map(str, chosen))}, detections: {name or 'none'}"
    return Dataset("panoptic", PANOPTIC19, takes, detector=name, source=words, notes=tuple(survey.notes))


def _cameras(views: int | Sequence[int]) -> tuple[int, ...]:
    if isinstance(views, int):
        if not 1 <= views <= len(CAMERAS):
            raise InvalidInputError(
                f"views: expected 1 to {len(CAMERAS)}, or numbers of cameras, got {views}"
            )
        return CAMERAS[:views]
    chosen = tuple(views)
    if not chosen or len(set(chosen)) < len(chosen):
        raise InvalidInputError(f"views: expected at least one camera and none twice, got {list(views)}")
    return chosen


def _calibrations(root: Path, sequence: str) -> list[Path]:
    name = f"calibration_{sequence}.json"
    return [root / sequence / name, root / "cameras" / name, root / name]


def _truth(
    survey: Survey, root: Path, sequence: str, options: tuple[int, str | None, str, int | None]
) -> tuple[Index, Array, Path]:
    """Frames (T,), joints (T, 19, 3) mm, and the file or folder they are from."""
    n_views, format, unit, person = options
    stems = [f"poses_filtered_{n_views}", "poses"]
    folder, bodies = root / "3d_gt" / "S0" / sequence, root / sequence / _TRUTHS["toolbox"]
    if format == "toolbox" or (format is None and poses_file(folder, stems) is None):
        return (*read_bodies(truth_files(survey.find([bodies], f"truth of {sequence}")), person), bodies)
    given, truth, frames = read_truth(survey, folder, PANOPTIC19.n_joints, stems)
    return np.arange(len(truth)) if frames is None else frames, MM_PER_UNIT[unit] * truth, given.path


def _with_detections(survey: Survey, take: Take, source: Path, guess: Path | None, *, filtered: bool) -> Take:
    """Return the frames of a take in which every view has a detection."""
    stems = [f"poses_filtered_{len(take.rig)}", "poses"] if filtered else ["poses"]
    wanted = Wanted(take.key, take.frames, take.rig.names, PANOPTIC19)
    spellings = [_spellings(name) for name in take.rig.names]
    places = [(source / take.action, stems), *([] if filtered else [(source, [take.action])])]
    values, own, path = read_apart(survey, places, wanted, spellings)
    everywhere: Mask = np.all(np.any(values[..., 2] > 0, axis=2), axis=1)
    world = None
    if guess is not None:
        world = read_world(survey, [(guess, stems)], (len(values), PANOPTIC19.n_joints), spellings)
    found = take.select(own).with_detections(values, path, monocular=world).select(everywhere)
    if lost := len(take) - len(found):
        survey.notes.append(f"{take.key}: {lost} of {len(take)} frames left out, not detected in every view")
    return found


def _spellings(name: str) -> list[str]:
    """Names that the folder of a camera may have: 00_03, 3, 03, hd03, cam3."""
    number = int(re.sub(r"^00_", "", name))
    return [camera_name(number), f"{number}", f"{number:02d}", f"hd{number:02d}", f"cam{number}"]


def camera_name(number: int) -> str:
    """Return the name of an HD camera: panel 0, node `number`."""
    return f"00_{number:02d}"


def truth_files(folder: Path) -> dict[int, Path]:
    """Return the file of each frame, ascending."""
    files = {}
    for path in sorted(folder.glob("body3DScene_*.json")):
        number = path.stem.removeprefix("body3DScene_")
        if not number.isdecimal():
            raise DatasetError(path, "file name", "body3DScene_ and a frame number", path.name)
        files[frame_number(path, "file name", number)] = path
    if not files:
        raise DatasetError(folder, "files", "body3DScene_%08d.json", "none")
    return dict(sorted(files.items()))


def read_bodies(files: Mapping[int, Path], person: int | None) -> tuple[Index, Array]:
    """Return the frames (T,) with the person in them and the joints (T, 19, 3), mm; NaN where not measured.

    `person` None is the only body that there is.
    """
    bodies = {frame: _bodies(path) for frame, path in files.items()}
    seen = Counter(name for there in bodies.values() for name in there)
    if person is None and len(seen) > 1:
        path = next(
            files[frame] for frame, there in bodies.items() if set(there) != {next(iter(seen))} and there
        )
        raise DatasetError(
            path, "bodies", "one person (choose one by id)", f"ids {', '.join(map(str, seen))}"
        )
    chosen = person if person is not None else next(iter(seen), -1)
    frames = [frame for frame, there in bodies.items() if chosen in there]
    if not frames:
        path = next(iter(files.values()))
        raise DatasetError(
            path.parent, "bodies", f"person {chosen}", f"ids {', '.join(map(str, seen)) or 'none'}"
        )
    return np.array(frames, dtype=np.int64), np.stack([bodies[frame][chosen] for frame in frames])


def _bodies(path: Path) -> dict[int, Array]:
    found = {}
    for body in load_json(path)["bodies"].entries():
        values = body["joints19"]
        count = len(values.content) if isinstance(values.content, list) else 0
        if count != 4 * PANOPTIC19.n_joints:
            expected = f"4·{PANOPTIC19.n_joints} numbers (x, y, z, c of 19 joints)"
            raise values.error(expected, f"{count} numbers")
        joints = values.numbers(count).reshape(-1, 4)
        measured = joints[:, 3:] > _LEAST_CONFIDENCE
        with np.errstate(over="ignore"):  # refused with the take
            found[body["id"].whole()] = np.where(measured, _MM * joints[:, :3], np.nan)
    return found
