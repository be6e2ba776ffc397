"""Simulated data sets, as ``skelsplat synth`` writes them (docs/synthetic-data.md)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import Any, TypeAlias

import numpy as np

from skelsplat import layouts
from skelsplat._skelsplat import Layout
from skelsplat.cameras import CameraRig
from skelsplat.datasets._files import Survey, load_json, load_npz, numbers, require, within
from skelsplat.datasets._model import Dataset, FloatArray, Take
from skelsplat.datasets._rig import build_camera, build_rig, component_reader
from skelsplat.datasets._synth_writer import FORMAT, FORMAT_VERSION, INDEX
from skelsplat.exceptions import DatasetError, InvalidInputError

Views: TypeAlias = int | Sequence[int | str] | None
"""The first so many cameras, or some of them by place or name, or (None) all."""

DESCRIPTION = "Simulated data sets that `skelsplat synth` writes."


def read(root: Path, *, detector: str = "good", views: Views = None) -> Dataset:
    """Read a simulated data set.

    Parameters
    ----------
    root : Path
    detector : str
        One of the index's detectors: ``"good"``, ``"noisy"``.
    views : int, sequence of int or str, or None
        The first so many cameras, or some by place or name; None is all.

    Raises
    ------
    DatasetError
        If a file is missing or malformed; names the file and the field.
    """
    index_path, index = _index(root)
    layout = _layout(index_path, index)
    known = require(index_path, "", index, "detectors")
    if detector not in known:
        raise DatasetError(index_path, "detectors", f"the detector {detector!r}", ", ".join(known))
    rigs = {
        name: _rig(root / "cameras" / f"{name}.json") for name in require(index_path, "", index, "cameras")
    }
    takes = tuple(
        _take(root, _Entry(index_path, f"takes[{k}]", entry), rigs, layout, detector)
        for k, entry in enumerate(require(index_path, "", index, "takes"))
    )
    name = str(require(index_path, "", index, "name"))
    seed = index.get("parameters", {}).get("seed")
    source = f"simulated poses and detections ({name}, detector {detector!r}, seed {seed}); no image was seen"
    return Dataset(
        name,
        layout,
        tuple(take.with_views(_places(take.files["cameras"], take.rig.names, views)) for take in takes),
        detector=f"simulated-{detector}",
        source=source,
    )


def survey(root: Path, *, detector: str = "good", views: Views = None) -> Survey:
    """Say which files are there."""
    del views
    if not (root / INDEX).is_file():
        return Survey(missing=[(root / INDEX, "index of a simulated data set")])
    path, index = _index(root)
    wanted = [(path, "index")]
    wanted += [(root / "cameras" / f"{name}.json", "cameras") for name in require(path, "", index, "cameras")]
    for k, entry in enumerate(require(path, "", index, "takes")):
        folder = _folder(root, path, f"takes[{k}]", entry)
        for stem in ("truth", f"detections_simulated_{detector}", "monocular_simulated"):
            wanted.append((folder / f"{stem}.npz", stem.replace("_", " ")))
    return Survey(
        there=[file for file, _ in wanted if file.is_file()],
        missing=[(file, what) for file, what in wanted if not file.is_file()],
    )


def _index(root: Path) -> tuple[Path, Mapping[str, Any]]:
    path = root / INDEX
    index = load_json(path)
    if require(path, "", index, "format") != FORMAT:
        raise DatasetError(path, "format", FORMAT, index["format"])
    if require(path, "", index, "format_version") != FORMAT_VERSION:
        raise DatasetError(path, "format_version", FORMAT_VERSION, index["format_version"])
    return path, index


def _layout(path: Path, index: Mapping[str, Any]) -> Layout:
    name = require(path, "", index, "layout")
    try:
        layout = layouts.get(name)
    except (InvalidInputError, TypeError) as error:
        raise DatasetError(path, "layout", f"one of {', '.join(layouts.names)}", repr(name)) from error
    if list(require(path, "", index, "joints")) != list(layout.joints):
        raise DatasetError(path, "joints", f"those of {name}", ", ".join(map(str, index["joints"])))
    return layout


def _rig(path: Path) -> CameraRig:
    document = load_json(path)
    cameras = []
    for k, entry in enumerate(require(path, "", document, "cameras")):
        field = f"cameras[{k}]"
        component = component_reader(path, field, entry)
        width, height = component("size", (2,))
        camera = build_camera(
            path,
            field,
            K=component("K", (3, 3)),
            R=component("R", (3, 3)),
            t=component("t", (3,)),
            distortion=component("distortion", ("n",)),
            size=(int(width), int(height)),
            name=str(require(path, field, entry, "name")),
        )
        cameras.append(camera)
    return build_rig(path, cameras, require(path, "", document, "unit"))


class _Entry:
    """A take in the index."""

    def __init__(self, path: Path, field: str, values: Any) -> None:
        self.path, self.field, self._values = path, field, values

    def __getitem__(self, key: str) -> Any:
        return require(self.path, self.field, self._values, key)


def _folder(root: Path, path: Path, field: str, entry: Any) -> Path:
    key = PurePosixPath(str(require(path, field, entry, "key")))
    if key.is_absolute() or ".." in key.parts:
        raise DatasetError(path, within(field, "key"), "a folder beneath takes", key)
    return root / "takes" / key


def _take(root: Path, entry: _Entry, rigs: Mapping[str, CameraRig], layout: Layout, detector: str) -> Take:
    rig = require(entry.path, "cameras", dict(rigs), entry["cameras"])
    folder = _folder(root, entry.path, entry.field, {"key": entry["key"]})
    files = {
        "truth": folder / "truth.npz",
        "detections": folder / f"detections_simulated_{detector}.npz",
        "monocular": folder / "monocular_simulated.npz",
    }
    loaded = {part: load_npz(path) for part, path in files.items()}
    frames = _frames(files, loaded)
    t, m, n = len(frames), len(rig), layout.n_joints

    def part(name: str, key: str, shape: tuple[int, ...]) -> FloatArray:
        return numbers(files[name], key, require(files[name], "", loaded[name], key), shape)

    cameras = root / "cameras" / f"{entry['cameras']}.json"
    per_view = (loaded["truth"].get("boxes"), loaded["detections"].get("detections"))
    _check_views(cameras, m, [np.asarray(array).shape for array in per_view])
    visible = loaded["truth"].get("visible")
    if visible is not None:
        visible = numbers(files["truth"], "visible", visible, (t, m, n)).astype(bool)
    return Take(
        key=str(entry["key"]),
        subject=str(entry["subject"]),
        action=str(entry["action"]),
        rig=rig,
        frames=frames,
        truth=part("truth", "poses", (t, n, 3)),
        detections=part("detections", "detections", (t, m, n, 3)),
        monocular=part("monocular", "poses", (t, m, n, 3)),
        boxes=part("truth", "boxes", (t, m, 4)),
        visible=visible,
        files={**files, "cameras": cameras},
    )


def _check_views(cameras: Path, count: int, shapes: Sequence[tuple[int, ...]]) -> None:
    """Raise if boxes and detections agree on another number of views than there are cameras."""
    views = {shape[1] if len(shape) > 1 else None for shape in shapes}
    if len(views) == 1 and views.isdisjoint({count, None}):
        raise DatasetError(cameras, "cameras", f"{views.pop()} cameras, one per view of the takes", count)


def _frames(files: Mapping[str, Path], loaded: Mapping[str, Mapping[str, Any]]) -> Any:
    """Frame numbers of the truth; those of the other files have to be the same."""
    frames = np.asarray(require(files["truth"], "", dict(loaded["truth"]), "frames"))
    if frames.ndim != 1 or frames.dtype.kind not in "iu":
        raise DatasetError(
            files["truth"], "frames", "a list of whole numbers", f"{frames.dtype} {frames.shape}"
        )
    for name, path in files.items():
        other = np.asarray(require(path, "", dict(loaded[name]), "frames"))
        if not np.array_equal(other, frames):
            expected = f"those of {files['truth'].name} ({len(frames)} from {frames[:1]} to {frames[-1:]})"
            actual = f"{other.size} from {other.ravel()[:1]} to {other.ravel()[-1:]}"
            raise DatasetError(path, "frames", expected, actual)
    return frames.astype(np.int64)


def _places(path: Path, names: Sequence[str], views: Views) -> list[int]:
    """Places of the chosen cameras among `names`, in the order chosen.

    `path` is the file that lists the cameras, for messages.

    Raises
    ------
    InvalidInputError
        If a camera is chosen twice, or none is.
    DatasetError
        If there are fewer cameras than chosen, or one is not there.
    """
    if views is None:
        return list(range(len(names)))
    if isinstance(views, int):
        views = list(range(views))
    chosen = [_place(path, names, view) for view in views]
    if not chosen or len(set(chosen)) < len(chosen):
        raise InvalidInputError(f"views: expected at least one camera and none twice, got {list(views)}")
    return chosen


def _place(path: Path, names: Sequence[str], view: int | str) -> int:
    there = f"{len(names)} ({', '.join(names)})"
    if isinstance(view, str):
        if view not in names:
            raise DatasetError(path, "cameras", f"camera {view!r}", there)
        return names.index(view)
    if not 0 <= view < len(names):
        raise DatasetError(path, "cameras", f"at least {view + 1} cameras", there)
    return view
