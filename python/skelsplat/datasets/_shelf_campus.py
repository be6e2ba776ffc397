"""Shelf and Campus: several people, few cameras, 14 joints; what both have in common.

- ``calibration_NAME.json`` as VoxelPose wrote it: {"0": {k, p, R, T, fx, fy, cx, cy}}, mm, x_cam = R (X − T);
- truth ``actorsGT.mat``, key ``actor3D``: cells of actors, of frames, of (14, 3) **metres**, empty where an
  actor is not labelled;
- detections ``2d_DETECTOR/S0/actorK[/CAMERA]/poses.npz`` or ``2d_DETECTOR/S0/actorK.npz``: which detection
  belongs to which actor is decided before. With 17 joints they are COCO-17 and become the 14, neck and head
  top interpolated from shoulders and ears;
- or detections of everybody, in which nothing says who is who: see `skelsplat.datasets._everybody`.

Each actor is a take; frames are those in which it is labelled. With detections of everybody alone, the takes
have those that are nearest to the projected truth (oracle association).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from skelsplat._arrays import Array, Index
from skelsplat._optional import require
from skelsplat._skelsplat import Layout
from skelsplat.cameras import CameraRig
from skelsplat.datasets._detections import Wanted, detections_of, detector_name, read_apart
from skelsplat.datasets._everybody import FILE, pickles, read_everybody
from skelsplat.datasets._files import Survey, a_table, find, load_json
from skelsplat.datasets._model import Dataset, Take
from skelsplat.datasets._people import PeopleTake, nearest_slots
from skelsplat.datasets._rig import build_rig, camera_at_centre
from skelsplat.exceptions import DatasetError
from skelsplat.io._mat import load_mat
from skelsplat.layouts import COCO17, SHELF14


@dataclass(frozen=True)
class Scene:
    """Which of the two: its name, image size, cameras and actors that are evaluated; and its reader."""

    name: str
    size: tuple[int, int]
    n_cameras: int
    n_actors: int = 3

    @property
    def DESCRIPTION(self) -> str:  # noqa: N802  as readers that are modules have it
        """One line for the list of data sets."""
        return f"{self.name.capitalize()}: several people in {self.n_cameras} cameras."

    def read(
        self, root: Path, *, detector: str | None = None, detections: Path | str | None = None
    ) -> Dataset:
        """Read the data set.

        Parameters
        ----------
        root : Path
        detector : str or None
            Name of the detector, as in ``2d_DETECTOR``; chosen as for Human3.6M when left out.
        detections : Path or None
            A folder of detections outside the root, in place of ``2d_DETECTOR/S0``, or a file of everybody.

        Raises
        ------
        DatasetError
            If a file is missing or malformed; names the file and the field.
        """
        calibration, truth = (
            find(places, f"{what} of {self.name}") for what, places in self._files(root).items()
        )
        rig = _rig(self, calibration)
        folder, everybody, name = self._detections(root, detector, detections)
        actors = read_actors(truth, SHELF14.n_joints)
        files = {"truth": truth, "cameras": calibration}
        scene = None if everybody is None else self._scene(everybody, rig, actors, files)
        takes = []
        for k, (frames, joints) in enumerate(actors[: self.n_actors]):
            if not len(frames):
                continue
            key = f"S0/actor{k}"
            take = Take(key, "S0", f"actor{k}", rig, frames, joints, fps=_FPS, files=files)
            takes.append(take if folder is None else _with_detections(take, folder))
        if scene is not None and folder is None:
            takes = list(scene.apart("S0"))
        words = f"{self.name.capitalize()}, one take per actor, detections: {name or 'none'}"
        scenes = () if scene is None else (scene,)
        return Dataset(self.name, SHELF14, tuple(takes), name, words, scenes=scenes)

    def _detections(
        self, root: Path, detector: str | None, given: Path | str | None
    ) -> tuple[Path | None, Path | None, str | None]:
        """Return the folder with detections per actor, the file of everybody, and the detector."""
        alone = pickles(root, self.name)
        wanted = None if detector is None else detector_name(detector)
        if given is not None and Path(given).is_file():
            return None, Path(given), wanted
        if given is None and wanted in alone:
            return None, alone[wanted], wanted
        folder, name = detections_of(root, detector, given)
        if folder is None and alone:
            return None, *next((path, key) for key, path in alone.items())
        everybody = None if folder is None or not (folder / FILE).is_file() else folder / FILE
        per_actor = folder is not None and any(folder.glob("actor*"))
        return (folder if per_actor or everybody is None else None), everybody, name

    def _scene(
        self, path: Path, rig: CameraRig, actors: Sequence[tuple[Index, Array]], files: Mapping[str, Path]
    ) -> PeopleTake:
        """Read the detections of everybody; actors who are not evaluated need not be found."""
        frames, people = read_everybody(path, rig.names, SHELF14.n_joints, from_coco)
        truth = np.full((len(actors), len(frames), SHELF14.n_joints, 3), np.nan)
        for own, (labelled, joints) in zip(truth, actors, strict=True):
            _, here, there = np.intersect1d(frames, labelled, return_indices=True)
            own[here] = joints[there]
        names = tuple(f"actor{k}" for k in range(len(actors)))
        return PeopleTake(
            key="S0",
            rig=rig,
            frames=frames,
            people=people,
            truth=truth,
            names=names,
            slots=nearest_slots(truth, rig, people),
            fps=_FPS,
            waived=names[self.n_actors :],
            files={**files, "detections": path},
        )

    def survey(self, root: Path, options: Mapping[str, Any]) -> Survey:
        """Say which files are there, with the options of `read`."""
        found = Survey()
        for what, places in self._files(root).items():
            found.look(places, what)
        alone = pickles(root, self.name)
        if alone and options["detections"] is None and not any(root.glob("2d_*")):
            found.look(list(alone.values()), "detections of everybody")
        else:
            found.look_for_detections(root, options["detector"], options["detections"], "hrnet")
        return found

    def _files(self, root: Path) -> dict[str, list[Path]]:
        """Return where the files may be that both `read` and `survey` look for."""
        name, inside = f"calibration_{self.name}.json", root / self.name.capitalize()
        return {
            "calibration": [root / name, inside / name, root / "cameras" / name],
            "truth": [root / "actorsGT.mat", inside / "actorsGT.mat"],
        }


SHELF = Scene("shelf", (1032, 776), 5)
CAMPUS = Scene("campus", (360, 288), 3)

_FPS = 25.0
_MM_PER_M = 1000.0
# The 12 limb joints of SHELF14 in COCO-17.
_FROM_COCO = (16, 14, 12, 11, 13, 15, 10, 8, 6, 5, 7, 9)


def _rig(scene: Scene, path: Path) -> CameraRig:
    content = a_table(path, "JSON", load_json(path), "a table of cameras")
    names = [str(k) for k in range(scene.n_cameras)]
    for name in names:
        if name not in content:
            raise DatasetError(
                path, "cameras", f"camera {name}", f"only {', '.join(sorted(content)) or 'none'}"
            )
    cameras = [camera_at_centre(path, name, content[name], size=scene.size, name=name) for name in names]
    return build_rig(path, cameras, "mm")


def _with_detections(take: Take, folder: Path) -> Take:
    spellings = [[name, f"cam{name}", f"Camera{name}"] for name in take.rig.names]

    def found_as(layout: Layout) -> tuple[Array, Index, Path]:
        wanted = Wanted(take.key, take.frames, take.rig.names, layout)
        places = [(folder / take.action, ["poses"]), (folder, [take.action])]
        return read_apart(places, wanted, spellings)

    try:
        found = found_as(SHELF14)
    except DatasetError as error:
        if f"{SHELF14.n_joints} joints" not in error.expected:
            raise
        try:
            found = found_as(COCO17)
        except DatasetError:
            raise error from None
        found = (from_coco(found[0]), *found[1:])
    values, places, path = found
    return take.select(places).with_detections(values, path)


def from_coco(detections: Array) -> Array:
    """Return SHELF14 detections (…, 14, 3) of COCO-17 ones (…, 17, 3).

    The neck (bottom of the head) is half-way between the middles of shoulders and ears; the top of the head
    is as far beyond the ears. Both are missing, and as uncertain as the worst, if shoulders or ears are.
    """
    limbs = detections[..., _FROM_COCO, :]
    ears, shoulders = (detections[..., pair, :].mean(axis=-2) for pair in ([3, 4], [5, 6]))
    confidence = detections[..., [3, 4, 5, 6], 2].min(axis=-1)
    bottom = 0.5 * (shoulders + ears)
    head = np.stack([bottom, 2.0 * ears - bottom], axis=-2)
    head[..., 2] = confidence[..., None]
    head[np.isnan(head[..., 0])] = (np.nan, np.nan, 0.0)
    return np.concatenate([limbs, head], axis=-2)


def read_actors(path: Path, n_joints: int) -> list[tuple[Index, Array]]:
    """Return frames (T,), from 0, and joints (T, N, 3) mm of each actor, where it is labelled."""
    require("scipy.io", str(path), "evaluation")
    content = load_mat(path, "a complete MATLAB file before version 7.3")
    if "actor3D" not in content:
        there = ", ".join(key for key in content if not key.startswith("__")) or "nothing"
        raise DatasetError(path, "actor3D", "cells of actors", f"only {there}")
    actors = _cells(content["actor3D"])
    while len(actors) == 1 and _is_cell(actors[0]) and _is_cell(actors[0].ravel()[0]):
        actors = _cells(actors[0])  # the cell of actors may lie in cells of its own
    if not actors:
        raise DatasetError(path, "actor3D", "cells of actors", "none")
    found = [_actor(path, f"actor3D{{{k + 1}}}", actor, n_joints) for k, actor in enumerate(actors)]
    lengths = {length for length, _, _ in found}
    if len(lengths) > 1:
        raise DatasetError(path, "actor3D", "as many frames for every actor", sorted(lengths))
    return [(frames, joints) for _, frames, joints in found]


def _is_cell(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.dtype == object and value.size > 0


def _cells(value: Any) -> list[Any]:
    return list(value.ravel()) if _is_cell(value) else []


def _actor(path: Path, field: str, cells: Any, n_joints: int) -> tuple[int, Index, Array]:
    frames, poses = [], []
    values = _cells(cells)
    for k, value in enumerate(values):
        pose = np.asarray(value)
        while pose.dtype == object and pose.size == 1:
            pose = np.asarray(pose.ravel()[0])
        if pose.size < 3:  # not labelled: an empty matrix, or a single zero
            continue
        if pose.shape != (n_joints, 3) or pose.dtype.kind not in "fiu":
            raise DatasetError(
                path, f"{field}{{{k + 1}}}", f"joints ({n_joints}, 3), metres", f"shape {pose.shape}"
            )
        frames.append(k)
        with np.errstate(over="ignore"):  # refused with the take
            poses.append(_MM_PER_M * pose.astype(np.float64))
    joints = np.stack(poses) if poses else np.empty((0, n_joints, 3))
    return len(values), np.array(frames, dtype=np.int64), joints
