"""Writers of every format of detections that is read, each by its own library where there is one.

A writer takes the folder to write into and a `Take`, and returns the path to read.
"""

from __future__ import annotations

import csv
import json
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from skelsplat import layouts

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

MEDIAPIPE = layouts.MEDIAPIPE33.joints
SCORER = "DLC_resnet50_gaitOct30shuffle1_100000"


def persons(people: np.ndarray) -> list[np.ndarray]:
    """Those of one image (P, K, 3) who are there."""
    return [person for person in people if np.isfinite(person).any()]


def zeros(person: np.ndarray) -> list[list[float]]:
    """Joints as lists; missing ones are zeros."""
    return np.nan_to_num(person).tolist()


def flat(person: np.ndarray) -> list[float]:
    return np.nan_to_num(person).ravel().tolist()


@dataclass(frozen=True)
class Take:
    """What is written."""

    people: np.ndarray  # (T, M, P, K, 3), NaN for missing
    names: list[str]  # of the cameras
    joints: list[str]
    first: int = 0  # frame number

    def views(self) -> Iterator[tuple[str, np.ndarray]]:
        """Each camera's name and people (T, P, K, 3)."""
        for m, name in enumerate(self.names):
            yield name, self.people[:, m]

    @property
    def frames(self) -> np.ndarray:
        return np.arange(self.first, self.first + len(self.people))


def per_frame(root: Path, take: Take, document: Callable[[list], object], ending: str) -> Path:
    for name, view in take.views():
        (root / name).mkdir(parents=True)
        for t, frame in enumerate(view):
            path = root / name / f"{take.first + t:06d}{ending}"
            path.write_text(json.dumps(document(persons(frame))))
    return root


def openpose(root: Path, take: Take) -> Path:
    def document(frame):
        return {"version": 1.3, "people": [{"person_id": [-1], "pose_keypoints_2d": flat(p)} for p in frame]}

    return per_frame(root, take, document, "_keypoints.json")


def easymocap(root: Path, take: Take) -> Path:
    def document(frame):
        found = [
            {"personID": i, "bbox": [0, 0, 9, 9, 0.9], "keypoints": zeros(p), "isKeyframe": False}
            for i, p in enumerate(frame)
        ]
        return {"filename": "images/1.jpg", "height": 1000, "width": 1000, "annots": found}

    return per_frame(root / "annots", take, document, ".json")


def mmpose(root: Path, take: Take) -> Path:
    def instance(person):
        keypoints, scores = np.nan_to_num(person[:, :2], nan=-1.0), np.nan_to_num(person[:, 2])
        box = {"bbox": [[0.0, 0.0, 9.0, 9.0]], "bbox_score": 0.9}
        return {"keypoints": keypoints.tolist(), "keypoint_scores": scores.tolist(), **box}

    names = {str(k): joint for k, joint in enumerate(take.joints)}
    meta = {"dataset_name": "own", "keypoint_id2name": names}
    for name, view in take.views():
        frames = [
            {"frame_id": take.first + t, "instances": [instance(p) for p in persons(frame)]}
            for t, frame in enumerate(view)
        ]
        (root / f"results_{name}.json").write_text(json.dumps({"meta_info": meta, "instance_info": frames}))
    return root


def _results(take: Take, view: np.ndarray, image: str) -> str:
    """Return a list of people in images by "number" or "name"."""
    return json.dumps(
        [
            {
                "image_id": take.first + t if image == "number" else f"{take.first + t}.jpg",
                "category_id": 1,
                "keypoints": flat(p),
                "score": 2.7,
            }
            for t, frame in enumerate(view)
            for p in persons(frame)
        ]
    )


def alphapose(root: Path, take: Take) -> Path:
    for name, view in take.views():
        (root / name).mkdir()
        (root / name / "alphapose-results.json").write_text(_results(take, view, "name"))
    return root


def coco(root: Path, take: Take) -> Path:
    for name, view in take.views():
        (root / f"{name}.json").write_text(_results(take, view, "number"))
    return root


def _rtmlib(root: Path, take: Take, save: Callable[[Path, np.ndarray, np.ndarray], None]) -> Path:
    for name, view in take.views():
        (root / name).mkdir()
        for t, frame in enumerate(view):
            found = np.array(persons(frame)).reshape(-1, len(take.joints), 3)
            save(root / name / f"{take.first + t:06d}", found[..., :2], np.nan_to_num(found[..., 2]))
    return root


def rtmlib_frames(root: Path, take: Take) -> Path:
    def save(path, keypoints, scores):
        np.savez(path, keypoints=np.nan_to_num(keypoints, nan=-1.0), scores=scores)

    return _rtmlib(root, take, save)


def rtmlib_pairs(root: Path, take: Take) -> Path:
    def save(path, keypoints, scores):
        np.save(f"{path}_keypoints.npy", keypoints)
        np.save(f"{path}_scores.npy", scores)

    return _rtmlib(root, take, save)


def rtmlib_cameras(root: Path, take: Take) -> Path:
    for name, view in take.views():
        frames = take.frames
        np.savez(root / f"{name}.npz", keypoints=view[..., :2], scores=view[..., 2], frames=frames)
    return root


def metrabs(root: Path, take: Take) -> Path:
    for name, view in take.views():
        (root / name).mkdir()
        arrays = {"frames": take.frames, "poses3d": np.zeros((len(view), 1, 17, 3))}
        np.savez(root / name / "poses.npz", poses2d=view[..., :2], **arrays)
    return root


def metrabs_ragged(root: Path, take: Take) -> Path:
    for name, view in take.views():
        parts = np.empty(len(view), dtype=object)
        for t, frame in enumerate(view):
            parts[t] = np.array(persons(frame)).reshape(-1, len(take.joints), 3)[..., :2]
        np.savez(root / f"{name}.npz", poses2d=parts, frames=take.frames)
    return root


def deeplabcut_table(view: np.ndarray, joints, first, *, multi: bool):
    """One camera's table; a multi-animal project has a part of its own beside the individuals."""
    import pandas as pd

    coords = ["x", "y", "likelihood"]
    frame = range(first, first + len(view))
    if not multi:
        columns = pd.MultiIndex.from_product(
            [[SCORER], joints, coords], names=["scorer", "bodyparts", "coords"]
        )
        return pd.DataFrame(view[:, 0].reshape(len(view), -1), columns=columns, index=frame)
    levels = ["scorer", "individuals", "bodyparts", "coords"]
    individuals = [f"individual{p + 1}" for p in range(view.shape[1])]
    columns = pd.MultiIndex.from_product([[SCORER], individuals, joints, coords], names=levels)
    own = pd.MultiIndex.from_product([[SCORER], ["single"], ["door"], coords], names=levels)
    values = np.hstack([view.reshape(len(view), -1), np.full((len(view), 3), 0.5)])
    return pd.DataFrame(values, columns=columns.append(own), index=frame)


def _deeplabcut(root: Path, take: Take, *, multi: bool, suffix: str, key="df_with_missing") -> Path:
    for name, view in take.views():
        table = deeplabcut_table(view, take.joints, take.first, multi=multi)
        path = root / f"{name}{SCORER}{'_el' if multi else ''}{suffix}"
        if suffix == ".csv":
            table.to_csv(path)
        else:
            table.to_hdf(path, key=key, format="table", mode="w")
    return root


deeplabcut = partial(_deeplabcut, multi=False, suffix=".h5")
deeplabcut_multi = partial(_deeplabcut, multi=True, suffix=".h5")
# what DeepLabCut's ``stitch_tracklets`` writes
deeplabcut_tracks = partial(_deeplabcut, multi=True, suffix=".h5", key="tracks")
deeplabcut_csv = partial(_deeplabcut, multi=False, suffix=".csv")
deeplabcut_csv_multi = partial(_deeplabcut, multi=True, suffix=".csv")


EDGES = [(0, 1), (1, 2), (2, 3), (0, 4)]
_SLEAP_AXES = ("frame", "track", "node", "xy")


def _sleap(root: Path, take: Take, *, axes, scores=True, **attrs) -> Path:
    """Write SLEAP's analysis files with these axes of the tracks, the rest as its `write_tracking_h5`."""
    import h5py

    order = [_SLEAP_AXES.index(axis) for axis in axes]
    rest = [at for at in order if at < 3]
    for name, view in take.views():
        with h5py.File(root / f"labels.v001.000_{name}.analysis.h5", "w") as file:
            sizes = {"compression": "gzip", "compression_opts": 9}
            file.create_dataset("tracks", data=view[..., :2].transpose(order), **sizes)
            if scores:
                file.create_dataset("point_scores", data=view[..., 2].transpose(rest), **sizes)
            seen = np.isfinite(view[..., 0]).any(axis=2)
            file.create_dataset("track_occupancy", data=seen.astype(np.uint8), **sizes)
            file.create_dataset("node_names", data=[np.bytes_(joint) for joint in take.joints])
            tracks = [np.bytes_(f"track_{p}") for p in range(view.shape[1])]
            file.create_dataset("track_names", data=tracks)
            edges = [edge for edge in EDGES if max(edge) < len(take.joints)]
            names = [[np.bytes_(take.joints[k]) for k in edge] for edge in edges]
            file.create_dataset("edge_names", data=names)
            file.create_dataset("edge_inds", data=edges)
            for key, value in attrs.items():
                file.attrs[key] = value
            if "preset" in attrs:
                file["tracks"].attrs["dims"] = json.dumps(axes)
    return root


_TURNED = ("track", "xy", "node", "frame")
sleap = partial(_sleap, axes=_TURNED)
# before version 1.1.4
sleap_without_scores = partial(_sleap, axes=_TURNED, scores=False)
# SLEAP's `write_occupancy_file` with ``transpose=False``
sleap_unturned = partial(_sleap, axes=("frame", "node", "xy", "track"))
# sleap-io with ``preset="standard"``
sleap_standard = partial(
    _sleap, axes=_SLEAP_AXES, preset="standard", format="analysis", sleap_io_version="1.0"
)


def sleap_csv(root: Path, take: Take) -> Path:
    """Write ``sleap-convert --format analysis.csv``; sleap-io sorts the nodes' columns by name."""
    for name, view in take.views():
        lines = [
            {
                "track": f"track_{p}",
                "frame_idx": take.first + t,
                "instance.score": 0.9,
                **dict(sorted(_node_columns(person, take.joints))),
            }
            for t, frame in enumerate(view)
            for p, person in enumerate(persons(frame))
        ]
        write_csv(root / f"labels.v001.000_{name}.analysis.csv", lines)
    return root


def _node_columns(person: np.ndarray, joints) -> Iterator[tuple[str, object]]:
    for joint, values in zip(joints, person, strict=True):
        for part, value in zip(("x", "y", "score"), values, strict=True):
            yield f"{joint}.{part}", "" if np.isnan(value) else value


def _caliscope(root: Path, take: Take, first: int = 1, *, camera: str, point: str, objects: bool) -> Path:
    """Write Caliscope's xy file, whose cameras have only numbers; a missing point has no line."""
    lines = [
        {
            "sync_index": take.first + t,
            camera: m + first,
            "frame_index": take.first + t + 3 * m,
            "frame_time": 48033.0 + t / 30,
            **({"object_id": p} if objects else {}),
            point: k,
            "img_loc_x": x,
            "img_loc_y": y,
            **dict.fromkeys(("obj_loc_x", "obj_loc_y"), ""),
        }
        for m, (_, view) in enumerate(take.views())
        for t, frame in enumerate(view)
        for p, person in enumerate(persons(frame))
        for k, (x, y, _) in enumerate(person)
        if np.isfinite(x)
    ]
    path = root / "xy_ONNX_rtmpose_t_halpe26.csv"
    write_csv(path, lines)
    return path


caliscope = partial(_caliscope, camera="cam_id", point="keypoint_id", objects=True)
# versions before 2026
caliscope_ports = partial(_caliscope, camera="port", point="point_id", objects=False)


def freemocap(root: Path, take: Take) -> Path:
    points = np.full((take.people.shape[1], len(take.people), 553, 2), np.nan)
    for k, joint in enumerate(take.joints):
        points[:, :, MEDIAPIPE.index(joint)] = take.people[:, :, 0, k, :2].swapaxes(0, 1)
    path = root / "mediapipe_2dData_numCams_numFrames_numTrackedPoints_pixelXY.npy"
    np.save(path, points)
    return path


def videopose3d_table(people, action="Directions 1") -> dict:
    return {"S9": {action: [people[:, m, 0, :, :2].astype(np.float32) for m in range(people.shape[1])]}}


def videopose3d(root: Path, take: Take) -> Path:
    path = root / "data_2d_h36m_cpn_ft_h36m_dbb.npz"
    pairs = [[4, 5, 6, 11, 12, 13], [1, 2, 3, 14, 15, 16]]
    metadata = {"layout_name": "h36m", "num_joints": 17, "keypoints_symmetry": pairs}
    np.savez_compressed(path, positions_2d=videopose3d_table(take.people), metadata=metadata)
    return path


def videopose3d_custom(root: Path, take: Take) -> Path:
    path = root / "data_2d_custom_walk.npz"
    table = {
        name: {"custom": [take.people[:, m, 0, :, :2].astype(np.float32)]}
        for m, name in enumerate(take.names)
    }
    metadata = {
        "layout_name": "coco",
        "num_joints": 17,
        "video_metadata": {name: {"w": 9} for name in take.names},
    }
    np.savez_compressed(path, positions_2d=table, metadata=metadata)
    return path


def npz(root: Path, take: Take) -> Path:
    path = root / "detections.npz"
    frames = take.frames
    np.savez(
        path, detections=take.people, camera_names=take.names, frames=frames, joint_names=list(take.joints)
    )
    return path


def npz_cameras(root: Path, take: Take) -> Path:
    for name, view in take.views():
        frames = take.frames
        np.savez(root / f"{name}.npz", detections=view[..., :2], confidence=view[..., 2], frames=frames)
    return root


def csv_lines(view: np.ndarray, joints, first) -> Iterator[dict[str, object]]:
    for t, frame in enumerate(view):
        for p, person in enumerate(persons(frame)):
            for joint, (x, y, c) in zip(joints, person, strict=True):
                if np.isfinite(x):
                    yield {"frame": first + t, "person": p, "joint": joint, "x": x, "y": y, "confidence": c}


def write_csv(path: Path, lines: list[dict[str, object]]) -> None:
    with path.open("w", newline="") as stream:
        writer = csv.DictWriter(stream, lines[0])
        writer.writeheader()
        writer.writerows(lines)


def plain_csv(root: Path, take: Take) -> Path:
    path = root / "detections.csv"
    cameras = take.views()
    write_csv(
        path,
        [
            {"camera": name, **line}
            for name, view in cameras
            for line in csv_lines(view, take.joints, take.first)
        ],
    )
    return path


def plain_csv_cameras(root: Path, take: Take) -> Path:
    places = [str(k) for k in range(len(take.joints))]
    for name, view in take.views():
        write_csv(root / f"{name}.csv", list(csv_lines(view, places, take.first)))
    return root


def wide_csv(root: Path, take: Take) -> Path:
    for name, view in take.views():
        lines = [
            {
                "frame": take.first + t,
                "timestamp": (take.first + t) / 30,
                **{
                    f"{joint}_{part}": "" if np.isnan(value) else value
                    for joint, values in zip(take.joints, frame[0], strict=True)
                    for part, value in zip(("x", "y", "likelihood"), values, strict=True)
                },
            }
            for t, frame in enumerate(view)
        ]
        write_csv(root / f"{name}.csv", lines)
    return root


def _slp_table(rows: list[tuple], **columns: str) -> np.ndarray:
    return np.array(rows, dtype=list(columns.items()))


def slp_file(path: Path, take: Take, videos: list[int], *, users=(), track=-1, format_id=1.3) -> None:
    """Write a SLEAP project; people in the places `users` were corrected and have a prediction besides."""
    import h5py

    made = [{"py/reduce": [{"py/type": "sleap.skeleton.EdgeType"}, {"py/tuple": [k]}]} for k in (1, 2)]
    kinds = [made[0], {"py/id": 1}, made[1], {"py/id": 2}]  # two edges, two pairs of symmetry
    links = [
        {"key": 0, "source": source, "target": target, "type": kind}
        for (source, target), kind in zip([(2, 0), (0, 1), (1, 2), (2, 1)], kinds, strict=True)
    ]
    order = [*range(len(take.joints))][::-1]  # of the nodes in the skeleton
    about = {
        "version": "2.0.0",
        "skeletons": [{"directed": True, "links": links, "nodes": [{"id": k} for k in order]}],
        "nodes": [{"name": joint, "weight": 1.0} for joint in take.joints],
    }
    frames, instances, points, guesses = [], [], [], []
    for video, m in enumerate(videos):
        for t, frame in enumerate(take.people[:, m]):
            first = len(instances)
            for p, person in enumerate(persons(frame)):
                for user in (False, True) if p in users else (False,):
                    table = points if user else guesses
                    linked = len(instances) - 1 if user and track < 0 else -1
                    wrong = 9.0 if p in users and not user else 0.0
                    for x, y, c in person[order] + wrong:
                        sees = bool(np.isfinite(x))
                        score = () if user else (c - wrong,)
                        table.append((x if sees else 5.0, y if sees else 5.0, sees, False, *score))
                    ends = (len(table) - len(order), len(table))
                    row = (len(instances), not user, len(frames), 0, track, linked, 0.9, *ends, 0.0)
                    instances.append(row)
            frames.append((len(frames), video, take.first + t, first, len(instances)))
    point = {"x": "<f8", "y": "<f8", "visible": "?", "complete": "?"}
    rows = {"instance_id": "<i8", "instance_type": "u1", "frame_id": "<u8", "skeleton": "<u4", "track": "<i4"}
    ends = {"from_predicted": "<i8", "score": "<f4", "point_id_start": "<u8", "point_id_end": "<u8"}
    places = {"frame_id": "<u8", "video": "<u4", "frame_idx": "<u8"}
    bounds = {"instance_id_start": "<u8", "instance_id_end": "<u8"}
    files = [{"filename": f"C:\\\\lab\\\\{take.names[m]}.mp4"} for m in videos]
    texts = [json.dumps({**one, "backend": one}) for one in files]
    with h5py.File(path, "w") as file:
        file.create_group("metadata").attrs["format_id"] = format_id
        file["metadata"].attrs["json"] = np.bytes_(json.dumps(about))
        file["frames"] = _slp_table(frames, **places, **bounds)
        file["instances"] = _slp_table(instances, **rows, **ends, tracking_score="<f4")
        file["points"] = _slp_table(points, **point)
        file["pred_points"] = _slp_table(guesses, **point, score="<f8")
        file.create_dataset("videos_json", data=texts, dtype=h5py.string_dtype())


def sleap_slp(root: Path, take: Take) -> Path:
    path = root / "labels.v001.slp"
    slp_file(path, take, list(range(len(take.names))))
    return path


def sleap_slp_cameras(root: Path, take: Take) -> Path:
    for m, name in enumerate(take.names):
        slp_file(root / f"{name}.predictions.slp", take, [m])
    return root


def hourglass(root: Path, take: Take) -> Path:
    import h5py

    for name, view in take.views():
        with h5py.File(root / f"Walking 1.{name}.h5", "w") as file:
            file["poses"] = view[:, 0, :, :2]
    return root


def ndx_pose(root: Path, take: Take) -> Path:
    """Write a container per camera as pynwb does: series share the times of the first by a link."""
    import h5py

    path = root / "session.nwb"
    with h5py.File(path, "w") as file:
        file.attrs["neurodata_type"] = "NWBFile"
        file.attrs.create(".specloc", file.create_group("specifications").ref, dtype=h5py.ref_dtype)
        skeleton = file.create_group("processing/behavior/Skeletons/body")
        skeleton.create_dataset("nodes", data=take.joints, dtype=h5py.string_dtype())
        skeleton["edges"] = np.array([edge for edge in EDGES if max(edge) < len(take.joints)], dtype=np.uint8)
        for m, name in enumerate(take.names):
            container = file.create_group(f"processing/behavior/{name}")
            container.attrs["neurodata_type"] = "PoseEstimation"
            container["body"] = h5py.SoftLink("/processing/behavior/Skeletons/body")
            container["scorer"] = "DLC"
            for k, joint in enumerate(take.joints):
                series = container.create_group(joint)
                series.attrs["neurodata_type"] = "PoseEstimationSeries"
                series["data"] = take.people[:, m, 0, k, :2]
                series["confidence"] = np.nan_to_num(take.people[:, m, 0, k, 2])
                if k:
                    first = f"/processing/behavior/{name}/{take.joints[0]}/timestamps"
                    series["timestamps"] = h5py.SoftLink(first)
                else:
                    series["timestamps"] = take.frames / 30
    return path


def ndx_pose_sleap(root: Path, take: Take) -> Path:
    """Write a container per animal as sleap-io does: without frames that lack a node, else with a rate."""
    import h5py

    path = root / "labels.nwb"
    with h5py.File(path, "w") as file:
        for m, name in enumerate(take.names):
            for p in range(take.people.shape[2]):
                container = file.create_group(f"processing/SLEAP_VIDEO_{m:03}_{name}/track=track_{p}")
                for k, joint in enumerate(take.joints):
                    view = take.people[:, m, p, k]
                    seen = np.isfinite(view).all(axis=1)
                    series = container.create_group(joint)
                    series.attrs["neurodata_type"] = "PoseEstimationSeries"
                    series["data"], series["confidence"] = view[seen, :2], view[seen, 2]
                    if seen.all():
                        series["starting_time"] = take.first / 30
                        series["starting_time"].attrs["rate"] = 30.0
                    else:
                        series["timestamps"] = take.frames[seen] / 30
    return path
