"""Detections in HDF5: SLEAP's projects and NWB with ndx-pose, of one camera or all, and hourglasses'."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

import numpy as np

from skelsplat._arrays import Array, Index
from skelsplat._budget import MOST_CAMERAS, check_ratio
from skelsplat._fields import FRAME_LIMIT, Field
from skelsplat.exceptions import DatasetError
from skelsplat.io._arrays import FRAME_RATES, array_names, as_numbers, hdf5_mentions, mentions
from skelsplat.io._files import json_document, listed
from skelsplat.io._guarded import read_hdf5
from skelsplat.io.detections._animals import edges_of
from skelsplat.io.detections._csv import SLEAP_ADDED
from skelsplat.io.detections._format import (
    DetectionFormat,
    Recording,
    View,
    array_view,
    each,
    frame_view,
    joints_of,
)

_NAMED = 8  # views in a message


def _only(path: Path, views: Mapping[str, View]) -> View:
    """Return the view in the file of one camera."""
    if len(views) != 1:
        expected = "one view in the file of each camera (or the path of this file)"
        raise DatasetError(path, "views", expected, listed(list(views), _NAMED) or "none")
    return next(iter(views.values()))


_TABLES = {
    "frames": ("video", "frame_idx", "instance_id_start", "instance_id_end"),
    "instances": ("instance_type", "skeleton", "track", "from_predicted", "point_id_start", "point_id_end"),
    "points": ("x", "y", "visible"),
    "pred_points": ("x", "y", "visible", "score"),
}
_USER, _KINDS = 0, 2  # of instances; the other is predicted
_CENTRES = 1.1  # format in which integers became pixel centres; before they were corners


def read_slp(path: Path) -> dict[str, View]:
    """Read SLEAP's labels, by video: people as `predicted`, or as a user corrected them.

    ``metadata`` has in JSON the names of the nodes and the skeletons, whose nodes are places in these;
    ``frames`` has for each labelled frame of a video its rows of ``instances``, these theirs of ``points`` (a
    user's) or ``pred_points``. A user's instance replaces the predicted one that it was made from, or of its
    track. What is not visible is missing.
    """
    file = read_hdf5(path, ["metadata", "videos_json", *_TABLES])
    arrays, about = file["arrays"], file["attributes"].get("metadata", {})
    document = json_document(path, "SLEAP's metadata", _text(path, "metadata", about.get("json", b"")))
    table = {name: _columns(path, arrays, name) for name in _TABLES}
    used = np.unique(table["instances"]["skeleton"]).tolist() or [0.0]
    skeletons = document["skeletons"].entries("a list of skeletons")
    if len(used) > 1 or used[0] not in range(len(skeletons)):
        raise DatasetError(path, "skeleton", f"the same of {len(skeletons)} for all instances", used)
    names, edges = _skeleton(skeletons[int(used[0])], document["nodes"])
    format_id = float(as_numbers(path, "format_id", about.get("format_id", _CENTRES)))
    corner = 0.5 if format_id < _CENTRES else 0.0
    points = [_points(path, name, table[name], corner) for name in ("points", "pred_points")]
    people = _people(path, table["frames"], table["instances"], points, len(names))
    labels = _videos(path, arrays.get("videos_json", ()), max(people, default=0) + 1)
    return {
        labels[video]: replace(
            frame_view(path, found, found.__getitem__), joints=names, edges=edges, sparse=True
        )
        for video, found in sorted(people.items())
    }


def _columns(path: Path, arrays: Mapping[str, Any], name: str) -> dict[str, Array]:
    """Return the columns of a table as numbers."""
    there = getattr(arrays.get(name), "dtype", np.dtype("f8")).names or ()
    lacking = [column for column in _TABLES[name] if column not in there]
    if lacking:
        what = "SLEAP's predictions, " * (name == "pred_points")
        expected = f"{what}a table with the columns {', '.join(_TABLES[name])}"
        raise DatasetError(path, name, expected, ", ".join(there) or "none")
    return {column: _flat(path, f"{name}.{column}", arrays[name][column]) for column in _TABLES[name]}


def _flat(path: Path, field: str, values: Any) -> Array:
    numbers = values.astype(np.float64) if values.dtype == bool else as_numbers(path, field, values)
    if numbers.ndim != 1 or np.isinf(numbers).any():
        raise DatasetError(path, field, "finite numbers, a row each", f"others, of shape {numbers.shape}")
    return numbers


def _text(path: Path, field: str, value: Any) -> str:
    """Return a text of HDF5, which may be bytes."""
    try:
        return value.decode() if isinstance(value, bytes) else str(value)
    except UnicodeDecodeError as error:
        raise DatasetError(path, field, "text in UTF-8", error) from error


def _skeleton(skeleton: Field, nodes: Field) -> tuple[tuple[str, ...], tuple[tuple[int, int], ...]]:
    """Return the names of a skeleton's nodes, and the pairs that are connected, but not those of symmetry."""
    every = [node["name"].text() for node in nodes.entries("a list of nodes")]
    places = [node["id"].index() for node in skeleton["nodes"].entries("a list of nodes")]
    if not places or max(places) >= len(every) or len(set(places)) < len(places):
        raise skeleton["nodes"].error(f"different places among {len(every)} nodes", places)
    names = array_names(skeleton.path, "nodes", [every[place] for place in places], len(places))
    edges = []
    for link in skeleton["links"].entries() if "links" in skeleton else []:
        # jsonpickle's: what was written before is named by its place, of bodies 1, of symmetry 2
        kind, made = link["type"]["py/id"].value, link["type"]["py/reduce"].value
        ends = [link[end].value for end in ("source", "target")]
        body = kind == 1 or (isinstance(made, list) and made[1:2] == [{"py/tuple": [1]}])
        if body and all(end in places for end in ends):
            edges.append((places.index(ends[0]), places.index(ends[1])))
    return names, tuple(edges)


def _points(path: Path, name: str, table: Mapping[str, Array], corner: float) -> Array:
    """Return points (n, 3) of a table; a user's are sure."""
    xy = np.column_stack([table["x"], table["y"]]) - corner
    sure = np.where(table["visible"] > 0.0, table.get("score", 1.0), 0.0)
    return joints_of(path, name, xy, sure, clip=True)


def _people(
    path: Path, frames: Mapping[str, Array], rows: Mapping[str, Array], points: list[Array], count: int
) -> dict[int, dict[int, list[Array]]]:
    """Return the people (count, 3) by video and frame."""
    columns = ("instance_type", "track", "from_predicted", "point_id_start", "point_id_end")
    with np.errstate(invalid="ignore"):  # of a number beyond all others, which fits no place
        instances = np.column_stack([rows[name] for name in columns]).astype(np.int64)
    people: dict[int, dict[int, list[Array]]] = {}
    table = np.column_stack([frames[name] for name in _TABLES["frames"]])
    many = len(instances)
    fits = ((table >= 0.0) & (table < [MOST_CAMERAS, FRAME_LIMIT, many + 1, many + 1])).all()
    rising = table[:, 3] - table[:, 2]
    if not fits or (rising < 0.0).any() or rising.sum() > many:
        expected = f"numbers of videos and frames, and places among {many} instances, each once"
        raise DatasetError(path, "frames", expected, "others")
    for video, frame, first, end in table.astype(np.int64).tolist():
        own = range(first, end)
        users = {row for row in own if instances[row, 0] == _USER}
        tracks = {int(instances[row, 1]) for row in users} - {-1}
        made = {int(instances[row, 2]) for row in users}
        found = people.setdefault(video, {}).setdefault(frame, [])
        for row in own:
            if row not in users and (row in made or int(instances[row, 1]) in tracks):
                continue
            kind, _, _, start, stop = instances[row].tolist()
            held = len(points[kind]) if kind in range(_KINDS) else 0
            if stop - start != count or not 0 <= start <= stop <= held:
                expected = f"{count} places of points, one per node"
                raise DatasetError(path, f"instances[{row}]", expected, f"{start} to {stop}")
            found.append(points[kind][start:stop])
    return people


def _videos(path: Path, texts: Any, count: int) -> list[str]:
    """Return labels of the videos: the names of their files, else of the folders, else their places."""
    files = []
    for k, text in enumerate(np.ravel(texts).tolist()):
        video = json_document(path, "a video of SLEAP", _text(path, f"videos_json[{k}]", text))
        name = (video["backend"] if "filename" in video["backend"] else video)["filename"].value
        files.append(PurePosixPath(str(name).replace("\\", "/")))
    for labels in ([file.stem for file in files], [file.parent.name for file in files]):
        if len(labels) >= count and len(set(labels)) == len(labels) and all(labels):
            return labels
    return [str(k) for k in range(max(count, len(files)))]


_CONTAINERS = "processing/*/*"
_PARTS = ("data", "confidence", "timestamps", "starting_time")
_SERIES, _OF_TRACK = "PoseEstimationSeries", "track="
_DECIMALS = 9  # of times in s, which the series of a container state apart
_LATEST = 1e12  # s
_LEAST_STEP = 0.5 + 1e-6  # between frames, of the usual one
_NO_RATE = 1.0  # which SLEAP writes if it does not know it


def read_nwb(path: Path) -> dict[str, View]:
    """Read the containers of ndx-pose, ``PoseEstimation`` of any processing module, as a view each.

    A container has a series per node: ``data`` (T, 2) in pixels, ``confidence`` (T,), and ``timestamps`` (T,)
    in s or ``starting_time`` with a ``rate``. SLEAP has a module per video, with a container per animal.
    Frames are counted by time, from 0 s.
    """
    skeletons = [
        f"{level}/{part}" for level in (_CONTAINERS, f"{_CONTAINERS}/*") for part in ("nodes", "edges")
    ]
    file = read_hdf5(path, [f"{_CONTAINERS}/*/", *skeletons])
    attributes = file["attributes"]
    series = [
        name.rstrip("/")
        for name in attributes
        if _text(path, name, attributes[name].get("neurodata_type")) == _SERIES
    ]
    if not series:
        raise DatasetError(path, "processing", "a container PoseEstimation of ndx-pose", "none")
    parts = read_hdf5(path, [f"{name}/{part}" for name in series for part in _PARTS])
    animals: dict[str, dict[str, dict[str, _Series]]] = {}
    for name in series:
        _, module, container, node = name.split("/")
        view = re.sub(r"^SLEAP_VIDEO_\d+_", "", module) if container.startswith(_OF_TRACK) else container
        animals.setdefault(view, {}).setdefault(container, {})[node] = _series(path, name, parts)
    return {view: _nwb_view(path, list(found.values()), file["arrays"]) for view, found in animals.items()}


class _Series(NamedTuple):
    """What a node's series states: joints (T, 3) and their times in s (T,)."""

    joints: Array
    times: Array


def _series(path: Path, name: str, file: Mapping[str, Any]) -> _Series:
    found = {part: file["arrays"].get(f"{name}/{part}") for part in _PARTS}
    pixels = as_numbers(path, f"{name}/data", found["data"])
    if pixels.ndim != 2 or pixels.shape[1] != 2:
        raise DatasetError(path, f"{name}/data", "pixels of shape (T, 2)", pixels.shape)
    sure = np.ones(len(pixels))
    if found["confidence"] is not None:
        sure = as_numbers(path, f"{name}/confidence", found["confidence"])
    if found["timestamps"] is not None:
        times = as_numbers(path, f"{name}/timestamps", found["timestamps"])
    else:
        start = as_numbers(path, f"{name}/starting_time", found["starting_time"])
        rate = as_numbers(
            path, f"{name}/starting_time", file["attributes"][f"{name}/starting_time"].get("rate")
        )
        with np.errstate(all="ignore"):
            times = start + np.arange(len(pixels)) / rate
    for part, values in (("confidence", sure), ("timestamps", times)):
        if values.shape != (len(pixels),):
            raise DatasetError(path, f"{name}/{part}", f"{len(pixels)} numbers, as of data", values.shape)
    if not (np.abs(times) < _LATEST).all() or (np.diff(times) <= 0.0).any():
        raise DatasetError(path, f"{name}/timestamps", "finite times that ascend", "others")
    return _Series(joints_of(path, f"{name}/data", pixels, sure, clip=True), times.round(_DECIMALS))


def _nwb_view(path: Path, animals: Sequence[Mapping[str, _Series]], skeletons: Mapping[str, Any]) -> View:
    """Return the view of a camera, with a place for each animal."""
    names = tuple(dict.fromkeys(node for animal in animals for node in animal))
    edges: tuple[tuple[int, int], ...] = ()
    for place, nodes in skeletons.items():
        if place.endswith("/nodes") and np.size(nodes) == len(names):
            own = array_names(path, place, np.ravel(nodes), len(names))
            if set(own) == set(names):
                names, pairs = own, skeletons.get(place.replace("/nodes", "/edges"), ())
                edges = edges_of(path, pairs, len(names))
    times = np.unique(np.concatenate([one.times for animal in animals for one in animal.values()]))
    frames, rate = _frames(path, times)
    check_ratio(path, "timestamps", 24 * len(frames) * len(animals) * len(names), path.stat().st_size)
    people = np.full((len(frames), len(animals), len(names), 3), np.nan)
    places = {name: place for place, name in enumerate(names)}
    for k, animal in enumerate(animals):
        for node, one in animal.items():
            people[np.searchsorted(times, one.times), k, places[node]] = one.joints
    return replace(array_view(path, people, frames), joints=names, edges=edges, rate=rate)


def _frames(path: Path, times: Array) -> tuple[Index, float | None]:
    """Return the numbers of the frames at times in s, which may drift, counted from 0 s, and their rate."""
    if len(times) < 2:
        return np.zeros(len(times), dtype=np.int64), None
    steps = np.diff(times) / np.median(np.diff(times))
    if (steps < _LEAST_STEP).any():
        raise DatasetError(path, "timestamps", "the same frames' times for all nodes", "others between them")
    passed = np.rint(steps).cumsum()
    rate = passed[-1] / (times[-1] - times[0])
    frames = np.rint(times[0] * rate) + np.append(0.0, passed)
    known = rate != _NO_RATE and FRAME_RATES[0] <= rate <= FRAME_RATES[1]
    return frames.astype(np.int64), float(f"{rate:.6g}") if known else None


_MPII = (
    *("right_ankle", "right_knee", "right_hip", "left_hip", "left_knee", "left_ankle", "pelvis", "thorax"),
    *("upper_neck", "head_top", "right_wrist", "right_elbow", "right_shoulder"),
    *("left_shoulder", "left_elbow", "left_wrist"),
)


def read_hourglass(path: Path) -> View:
    """Read ``poses`` (T, 16, 2) of a stacked hourglass, MPII's joints, as 3d-pose-baseline has Human3.6M."""
    pixels = as_numbers(path, "poses", read_hdf5(path, ["poses"])["arrays"].get("poses"))
    if pixels.ndim != 3 or pixels.shape[1:] != (len(_MPII), 2):
        raise DatasetError(path, "poses", f"pixels of shape (T, {len(_MPII)}, 2)", pixels.shape)
    joints = joints_of(path, "poses", pixels[:, None], None, clip=False)
    return replace(array_view(path, joints), joints=_MPII)


def _is_hourglass(path: Path) -> bool:
    others = (b"pandas_type", b"node_names")
    return hdf5_mentions(path, b"poses") and not any(hdf5_mentions(path, name) for name in others)


def _format(
    name: str, suffix: str, read: Callable[[Path], dict[str, View]], *marks: bytes
) -> DetectionFormat:
    """Return a format whose files have one camera each, or all."""
    one, every = (lambda path: _only(path, read(path))), (lambda path, _: Recording(read(path), named=True))
    return DetectionFormat(name, (suffix,), mentions(*marks), each(one), recording=every, added=SLEAP_ADDED)


FORMATS = (
    _format("sleap_slp", ".slp", read_slp, b"instance_id_start"),
    # the camera's name is behind that of an action
    DetectionFormat("hourglass", (".h5",), _is_hourglass, each(read_hourglass), added=r"^.*\."),
    _format("ndx_pose", ".nwb", read_nwb),  # which tells of other data
)
