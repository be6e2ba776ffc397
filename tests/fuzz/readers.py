"""Mutated files of every format that is read: a result, or an error that names the file."""

from __future__ import annotations

import dataclasses
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from pathlib import Path
from random import Random
from typing import Any
from unittest import mock

import numpy as np

import calibration_files
import skelsplat as sk
from detection_cases import CASES
from detection_files import Take, hourglass
from fuzz import mutate
from pose_sample import sample
from skelsplat import datasets, layouts, synthetic
from skelsplat.datasets.synthetic import write_simulated
from skelsplat.io import (
    read_calibration,
    read_detections,
    read_layout,
    read_pose,
    read_run,
    read_skeleton,
    write_pose,
)
from skelsplat.io.poses import READ
from skelsplat.run import Run
from writers import human36m, occlusion_person, panoptic, shelf_campus

Reader = Callable[[Path], object]
T, RIG = 3, synthetic.human36m_like()
POSE = synthetic.motion("walk", T, seed=3)
SEEN = synthetic.simulate_detections(POSE, RIG, noise=synthetic.DetectionNoise(), seed=1)
# arguments that the files leave open, of which an error may speak
ASKED = ["layout", "unit", "size", "cameras", "order", "subject", "sequence", "format", "fps", "name"]


def _calibration(write: Callable[..., Path], options: Mapping[str, Any]) -> Callable[[Path], Reader]:
    def prepare(folder: Path) -> Reader:
        path = write(folder, calibration_files.reference(calibration_files.NAMES))
        return lambda root: read_calibration(root / path.relative_to(folder), **options)

    return prepare


def _detections(name: str, frames: str) -> Callable[[Path], Reader]:
    def prepare(folder: Path) -> Reader:
        case = CASES[name]
        people = np.stack([SEEN, SEEN[::-1]], axis=2) if case.people else SEEN[:, :, None]
        take = Take(people, list(RIG.names), list(layouts.get(case.layout).joints), 5)
        path = case.write(folder, take).relative_to(folder)
        options: dict[str, Any] = {"order": case.order, "frames": frames}
        return lambda root: read_detections(root / path, RIG, layout=case.layout, **options)

    return prepare


def _hourglass(folder: Path) -> Reader:
    hourglass(folder, Take(SEEN[:, :, None, :16], list(RIG.names), []))
    return lambda root: read_detections(root, RIG, layout="file")


def _skeleton(name: str) -> Callable[[Path], Reader]:
    def prepare(folder: Path) -> Reader:
        take = Take(SEEN[:, :, None], list(RIG.names), list(layouts.H36M17.joints), 5)
        path = CASES[name].write(folder, take).relative_to(folder)
        return lambda root: (read_detections(root / path, RIG, layout="file"), read_skeleton(root / path))

    return prepare


def _pose(kind: str) -> Callable[[Path], Reader]:
    def prepare(folder: Path) -> Reader:
        write_pose(
            folder / f"pose.{kind}", sample(), **({"frame_rate": 60.0} if kind in ("trc", "c3d") else {})
        )
        return lambda root: read_pose(root / f"pose.{kind}")

    return prepare


def _layout(folder: Path) -> Reader:
    layouts.write(folder / "own.toml", layouts.H36M17)
    return lambda root: (read_layout(root / "own.toml"), layouts.about(root / "own.toml"))


def _run(folder: Path) -> Reader:
    run = Run.from_arrays(sk.refine(None, SEEN, RIG, layout="h36m17"), RIG, SEEN, "h36m17")
    with mock.patch("skelsplat.run.figures.write_figures", return_value=[]):
        run.write(folder / "run", html=False)
    return lambda root: (read_run(root / "run"), Run.open(root / "run"))


def _data(name: str, write: Callable[[Path], object], **options: Any) -> Callable[[Path], Reader]:
    def prepare(folder: Path) -> Reader:
        write(folder / "data")

        def read(root: Path) -> object:
            given = {key: root / "data" / value for key, value in options.items()}
            datasets.check(name, root / "data", **given).to_dict()
            return datasets.read(name, root / "data", **given)

        return read

    return prepare


def _human36m(layout: str) -> Callable[[Path], object]:
    def write(root: Path) -> None:
        root.mkdir()
        recording = human36m.record(frames=2)
        recording.takes = recording.takes[:2] + recording.takes[4:6]
        getattr(human36m, f"write_{layout}")(root, recording)

    return write


SAMPLES: dict[str, Callable[[Path], Reader]] = {
    **{
        f"calibration {name}": _calibration(*one[:2])
        for name, one in {**calibration_files.FORMATS_WRITTEN, **calibration_files.OTHERS}.items()
    },
    "calibration pyxy3d": _calibration(calibration_files.pyxy3d, {}),
    "calibration vicon": _calibration(calibration_files.vicon, {}),
    **{
        f"detections {name}": _detections(name, ("strict", "union", "intersection")[i % 3])
        for i, name in enumerate(CASES)
    },
    "detections hourglass": _hourglass,
    "skeleton": _skeleton("sleap"),
    "skeleton of a csv": _skeleton("deeplabcut_csv"),
    **{f"pose {kind}": _pose(kind) for kind in READ},
    "layout": _layout,
    "run": _run,
    "data authors": _data("human36m", _human36m("skelsplat")),
    "data videopose3d": _data("human36m", _human36m("videopose3d")),
    "data hourglass": _data("human36m-hourglass", _human36m("hourglass")),
    "data panoptic": _data("panoptic", lambda root: panoptic.write(root, n_frames=2)),
    "data person": _data("occlusion-person", lambda root: occlusion_person.write(root, per_scene=2)),
    "data shelf": _data("shelf", lambda root: shelf_campus.write(root, "shelf", n_frames=302)),
    "data campus": _data("campus", lambda root: shelf_campus.write(root, "campus", n_frames=352)),
    "data synthetic": _data(
        "synthetic", lambda root: write_simulated(root, synthetic.simulate_set("human36m-like", poses=60))
    ),
    "data people": _data(
        "synthetic", lambda root: write_simulated(root, synthetic.simulate_people_set(2, 3, 1, frames=3))
    ),
}
"""Name → what writes it into a folder, and returns the function that reads it from one."""


@cache
def written(name: str) -> tuple[dict[str, bytes], Reader]:
    """Return the files of a sample, by path, and what reads them."""
    folder = Path(tempfile.mkdtemp())
    try:
        read = SAMPLES[name](folder)
        files = {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}
    finally:
        shutil.rmtree(folder)
    return files, read


def case(rng: Random, folder: Path) -> tuple[str, Callable[[], str]]:
    """Write a sample with one or two of its files mutated, and return how it is read."""
    name = rng.choice(list(SAMPLES))
    files, read = written(name)
    changed = rng.sample(list(files), min(len(files), rng.choice((1, 1, 1, 2))))
    for path, data in files.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_bytes(mutate.file(rng, data, path) if path in changed else data)
    return f"{name}: {', '.join(changed)}", lambda: tried(folder, read)


def tried(folder: Path, read: Reader) -> str:
    """Read, and return what came of it; raise for anything but a sound result or a proper error."""
    try:
        result = read(folder)
    except sk.DatasetError as error:
        return one_line(error, holds=str(folder))
    except sk.InvalidInputError as error:
        return one_line(error, starts_with=error.argument if error.argument in ASKED else "another argument")
    for where, array in numbers(result):
        assert not np.isinf(array).any(), f"infinite: {where}"
    return "read"


def one_line(error: Exception, *, holds: str = "", starts_with: str = "") -> str:
    """Return "refused" if the message is one line of some length that says where it comes from."""
    message = str(error)
    assert len(message.splitlines()) == 1, "not one line"
    assert len(message) < 2000, "a line of more than 2000 characters"
    assert holds in message, f"{holds} is not in: {message}"
    assert message.startswith(starts_with), f"{starts_with} is not named in: {message}"
    return "refused"


def numbers(value: Any, where: str = "") -> Iterator[tuple[str, np.ndarray]]:
    """Every array of floating-point numbers in a result, and where it is."""
    if isinstance(value, np.ndarray) and value.dtype.kind == "f":
        yield where, value
    elif isinstance(value, sk.Camera):
        for name in ("K", "R", "t"):
            yield f"camera.{name}", getattr(value, name)
    elif dataclasses.is_dataclass(value):
        for field in dataclasses.fields(value):
            yield from numbers(getattr(value, field.name, None), field.name)
    elif isinstance(value, tuple | list | sk.CameraRig):
        for inner in value:
            yield from numbers(inner, where)
