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
from typing import Any

import numpy as np

from skelsplat._arrays import Array, Index, Mask
from skelsplat.cameras import MM_PER_UNIT, CameraRig
from skelsplat.datasets._detections import Wanted, detections_of, read_apart, read_truth, read_world
from skelsplat.datasets._files import Survey, a_list, find, load_json, numbers, require, whole_number, within
from skelsplat.datasets._model import Dataset, Take
from skelsplat.datasets._rig import read_quietly
from skelsplat.exceptions import DatasetError, InvalidInputError, one_of
from skelsplat.io import convert_unit
from skelsplat.io._arrays import frame_numbers
from skelsplat.io._files import frame_number
from skelsplat.layouts import PANOPTIC19

DESCRIPTION = "CMU Panoptic Studio: single-person sequences in HD cameras."

SEQUENCES = ("171204_pose5", "171204_pose6")
CAMERAS = (1, 2, 10, 13, 3, 23, 19, 30)
"""HD cameras in the order in which the experiments add them: the first four, then one by one."""

_TRUTH = "hdPose3d_stage1_coco19"
_FORMATS = ("toolbox", "skelsplat")
_MM = 10.0
_HD_FPS = 29.97
# A joint with less confidence is no measurement; the toolbox writes −1 where there is none at all.
_LEAST_CONFIDENCE = 0.1


def read(
    root: Path,
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
    root : Path
    detector : str or None
        Name of the detector, as in ``2d_DETECTOR``; chosen as for Human3.6M when left out.
    detections : Path or None
        A folder of detections outside the root.
    views : int or sequence of int
        The first so many of `CAMERAS`, or numbers of HD cameras.
    sequences : sequence of str
    format : {"toolbox", "skelsplat"} or None
        Where the truth is; None looks.
    truth_unit : {"cm", "mm", "m"}
        Unit of the truth in format ``"skelsplat"``; that of the toolbox is always cm.
    person : int or None
        Id of the body to take where there are several.
    monocular : str or None
        The folder in ``initial_guess`` with world poses, mm, a row per row of the detections.

    Raises
    ------
    DatasetError
        If a file is missing or malformed; names the file and the field.
    InvalidInputError
        If `views`, `format` or `truth_unit` is unknown.
    """
    numbers_ = _cameras(views)
    source, name = detections_of(root, detector, detections)
    takes, notes = [], []
    for sequence in sequences:
        path = find(_calibrations(root, sequence), f"calibration of {sequence}")
        rig = read_cameras(path, numbers_)
        frames, truth, truth_path = _truth(
            find(_truths(root, sequence, len(rig), format), f"truth of {sequence}"), truth_unit, person
        )
        files = {"cameras": path, "truth": truth_path}
        take = Take(f"S0/{sequence}", "S0", sequence, rig, frames, truth, fps=_HD_FPS, files=files)
        if source is not None:
            guess = None if monocular is None else root / "initial_guess" / monocular / "S0" / sequence
            take, note = _with_detections(take, source, guess, filtered=detections is None)
            notes += [note] if note else []
        takes.append(take)
    words = f"CMU Panoptic, HD cameras {', '.join(map(str, numbers_))}, detections: {name or 'none'}"
    return Dataset("panoptic", PANOPTIC19, tuple(takes), detector=name, source=words, notes=tuple(notes))


def survey(root: Path, options: Mapping[str, Any]) -> Survey:
    """Say which files are there, with the options of `read`."""
    detector, detections, format = (options[name] for name in ("detector", "detections", "format"))
    found, count = Survey(format=format or ""), len(_cameras(options["views"]))
    for sequence in options["sequences"]:
        found.look(_calibrations(root, sequence), f"calibration of {sequence}")
        found.look(_truths(root, sequence, count, format), f"truth of {sequence}")
        if detections is not None or detector is not None:
            folder = Path(detections) if detections is not None else root / f"2d_{detector}" / "S0"
            found.look([folder / sequence], f"detections of {sequence}")
    if detections is None and detector is None and not sorted(root.glob("2d_*")):
        found.look([root / "2d_metrabs" / "S0"], "detections")
    return found


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


def _truths(root: Path, sequence: str, n_views: int, format: str | None) -> list[Path]:
    one_of("format", format, (None, *_FORMATS))
    folder = root / "3d_gt" / "S0" / sequence
    arrays = [folder / f"poses_filtered_{n_views}.npz", folder / "poses.npz"]
    return {"toolbox": [], "skelsplat": arrays}.get(format or "", arrays) + (
        [] if format == "skelsplat" else [root / sequence / _TRUTH]
    )


def _truth(path: Path, unit: str, person: int | None) -> tuple[Index, Array, Path]:
    """Frames (T,), joints (T, 19, 3) mm, and the file or folder they are from."""
    one_of("truth_unit", unit, MM_PER_UNIT)
    if path.is_dir():
        return (*read_bodies(truth_files(path), person), path)
    _, truth, frames = read_truth(path, PANOPTIC19.n_joints)
    own = frame_numbers(path, np.arange(len(truth)) if frames is None else frames, len(truth))
    return own, MM_PER_UNIT[unit] * truth, path


def _with_detections(take: Take, source: Path, guess: Path | None, *, filtered: bool) -> tuple[Take, str]:
    """Return the frames of a take in which every view has a detection, and what was left out."""
    stems = [f"poses_filtered_{len(take.rig)}", "poses"] if filtered else ["poses"]
    wanted = Wanted(take.key, take.frames, take.rig.names, PANOPTIC19)
    spellings = [_spellings(name) for name in take.rig.names]
    places = [(source / take.action, stems), *([] if filtered else [(source, [take.action])])]
    values, own, path = read_apart(places, wanted, spellings)
    everywhere: Mask = np.all(np.any(values[..., 2] > 0, axis=2), axis=1)
    world = None
    if guess is not None:
        world = read_world(guess, stems, (len(values), PANOPTIC19.n_joints), spellings)
    with_2d = take.select(own).with_detections(values, path, monocular=world).select(everywhere)
    lost = len(take) - len(with_2d)
    note = f"{take.key}: {lost} of {len(take)} frames left out, not detected in every view"
    return with_2d, note if lost else ""


def _spellings(name: str) -> list[str]:
    """Names that the folder of a camera may have: 00_03, 3, 03, hd03, cam3."""
    number = int(re.sub(r"^00_", "", name))
    return [camera_name(number), f"{number}", f"{number:02d}", f"hd{number:02d}", f"cam{number}"]


def camera_name(number: int) -> str:
    """Return the name of an HD camera: panel 0, node `number`."""
    return f"00_{number:02d}"


def read_cameras(path: Path, chosen: Sequence[int]) -> CameraRig:
    """Return the HD cameras with these numbers, in this order, mm."""
    rig = convert_unit(read_quietly(path, "panoptic", camera_type="hd"), "mm")
    names = [camera_name(number) for number in chosen]
    for name in names:
        if name not in rig.names:
            raise DatasetError(path, "cameras", f"HD camera {name}", f"only {', '.join(sorted(rig.names))}")
    return CameraRig([rig[name] for name in names], rig.unit)


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
    for k, body in enumerate(a_list(path, "bodies", require(path, "", load_json(path), "bodies"))):
        field = f"bodies[{k}]"
        values = require(path, field, body, "joints19")
        count = len(values) if isinstance(values, list) else 0
        expected = f"4·{PANOPTIC19.n_joints} numbers (x, y, z, c of 19 joints)"
        if count != 4 * PANOPTIC19.n_joints:
            raise DatasetError(path, within(field, "joints19"), expected, f"{count} numbers")
        flat = numbers(path, within(field, "joints19"), values, (count,))
        joints = flat.reshape(-1, 4)
        measured = joints[:, 3:] > _LEAST_CONFIDENCE
        with np.errstate(over="ignore"):  # refused with the take
            found[whole_number(path, field, body, "id")] = np.where(measured, _MM * joints[:, :3], np.nan)
    return found
