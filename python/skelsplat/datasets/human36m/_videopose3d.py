"""VideoPose3D's archives: ``data_3d_h36m.npz`` and ``data_2d_h36m_<detector>.npz``.

``positions_3d`` [subject][activity] (T, 32, 3), **metres**, world; ``positions_2d`` [subject][activity] a
list of one (T, 17, 2) per camera, pixels. S11 "Directions" is not in it. The cameras are not in it either:
``camera-parameters.json`` is needed beside it. Detections may run on after the truth has ended; the rest is
cut off, as VideoPose3D does.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from skelsplat.datasets._detections import Wanted, as_detections, detector_name
from skelsplat.datasets._files import Survey, load_npz
from skelsplat.datasets._model import Take
from skelsplat.datasets.human36m._common import CAMERAS, Options, activity_of, read_rig, take_of
from skelsplat.layouts import H36M17

NAME = "videopose3d"
HAS = "data_3d_h36m.npz"
USUAL = "data_2d_h36m_<detector>.npz"
_MM = 1000.0

JOINTS_OF_32 = (0, 1, 2, 3, 6, 7, 8, 12, 13, 14, 15, 17, 18, 19, 25, 26, 27)
"""Place of each h36m17 joint among the 32 of the motion capture."""


def locate(root: Path) -> Path | None:
    """Return the folder with the archives: the root or ``data`` in it."""
    return next((folder for folder in (root, root / "data") if (folder / HAS).is_file()), None)


def takes(root: Path, options: Options, survey: Survey) -> Iterator[Take]:
    """Give the takes in the archives beneath `root`."""
    cameras = options.find_cameras(survey, root)
    path = survey.find([root / HAS], "truth")
    files = {"truth": path, "cameras": cameras}
    positions = load_npz(path, ("positions_3d",))["positions_3d"].table()
    for subject in options.chosen(path, map(str, positions)):
        rig = read_rig(cameras, subject)
        for activity, value in positions[subject].table().items():
            truth = value.numbers("frames", "joints", 3)
            if truth.shape[1] == 32:
                truth = truth[:, list(JOINTS_OF_32)]
            if truth.shape[1] != H36M17.n_joints:
                raise value.error("32 joints, or 17 of h36m17", truth.shape[1])
            yield take_of(subject, activity, rig, _MM * truth, files)


def detectors(root: Path) -> dict[str, Path]:
    """Return the archives of detections by the name of the detector."""
    return {detector_name(path.stem): path for path in sorted(root.glob("data_2d_h36m_*.npz"))}


def adding(path: Path, survey: Survey) -> Callable[[Take], Take]:
    """Return what gives a take its detections in ``data_2d_h36m_<detector>.npz``, one array per camera."""
    positions = load_npz(survey.found(path), ("positions_2d",))["positions_2d"]

    def add(take: Take) -> Take:
        views = positions[take.subject].table().get(activity_of(take))
        if views is None:
            return take
        given, parts = views.entries(), []
        if len(given) != len(CAMERAS):
            raise views.error(f"{len(CAMERAS)} cameras ({', '.join(CAMERAS)})", len(given))
        for name, view in zip(CAMERAS, given, strict=True):
            at = replace(view, place=f"{views.place}, camera {name}")
            pixels = at.numbers("frames", "joints", 2)
            note = f"{path.name}: views cut where the truth ends"
            if len(pixels) > len(take) and note not in survey.notes:
                survey.notes.append(note)
            one = replace(at, content=pixels[: len(take), None])
            parts.append(as_detections(one, Wanted(take.key, take.frames, (name,), H36M17)))
        return take.with_detections(np.concatenate(parts, axis=1), path)

    return add
