"""Malformed detections in npz, npy and h5: one thing broken in a valid set, and the line that says so."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from broken_detections import Broken, K, T, above_one, check, fewest_twins, renamed, without_x
from detection_files import videopose3d_table


class Bomb:
    def __reduce__(self):
        return (print, ("a pickle was run",))


def attr(key, name, value):
    return lambda file: file[key].attrs.__setitem__(name, value)


def replaced(key, value):
    def change(file):
        old = file[key][()]
        del file[key]
        file[key] = value(old)

    return change


def _ragged(*shapes):
    parts = np.empty(len(shapes), dtype=object)
    for t, shape in enumerate(shapes):
        parts[t] = np.full(shape, 5.0)
    return parts


def _long_name(broken):
    """Say in the root's attributes that the name of one is longer than all of them, which ends PyTables."""
    content = bytearray(broken.file.read_bytes())
    at = content.index(b"PYTABLES_FORMAT_VERSION")
    content[at - 6 : at - 4] = b"\xff\xff"
    broken.file.write_bytes(content)


NPZ_CUT = (Broken.cut, r"file: expected a complete npz file, got ")
MALFORMED = {
    "rtmlib_frames": {
        "cut": NPZ_CUT,
        "no scores": (
            lambda b: b.npz(scores=None),
            r"scores: expected an array under this key, got keys keyp",
        ),
        "no people axis": (
            lambda b: b.npz(keypoints=b.array("keypoints")[0]),
            r"keypoints: expected shape \(P, K, 2\), got \(17, 2\)",
        ),
        "scores of others": (
            lambda b: b.npz(scores=b.array("scores")[:, :-1]),
            r"scores: expected shape \(2, 17\) like the keypoints, got \(2, 16\)",
        ),
        "text": (lambda b: b.npz(scores=np.full((2, K), "a")), r"scores: expected an array of numbers, got"),
        "infinite": (
            lambda b: b.npz(keypoints=np.full((2, K, 2), np.inf)),
            r"keypoints: expected pixels, NaN for missing, got an infinite number",
        ),
    },
    "rtmlib_pairs": {
        "cut": (Broken.cut, r"array: expected an array in npy format, got |cut short"),
        "no scores": (lambda b: b.file.unlink(), r"file: expected a readable npy file, got no such file"),
        "no npy": (lambda b: b.file.write_text("1 2 3"), r"array: expected an array in npy format"),
        "open bracket": (
            lambda b: b.file.write_bytes(b.file.read_bytes().replace(b"), }", b", } ", 1)),
            r"array: expected an array in npy format",
        ),
    },
    "rtmlib_cameras": {
        "frames": (
            lambda b: b.npz(frames=np.array([2, 1, 0])),
            r"frames: expected 3 whole numbers that ascend",
        ),
        "one frame's": (
            lambda b: b.npz(keypoints=b.array("keypoints")[0], scores=b.array("scores")[0]),
            r"keypoints: expected shape \(T, P, K, 2\), got \(2, 17, 2\)",
        ),
        "cut": NPZ_CUT,
    },
    "metrabs": {
        "cut": NPZ_CUT,
        "no poses2d": (
            lambda b: b.npz(poses2d=None),
            r"poses2d: expected an array under this key, got keys frames, poses3d",
        ),
        "3D": (
            lambda b: b.npz(poses2d=np.ones((T, K, 3))),
            r"poses2d: expected pixels of shape \(T, K, 2\) or \(T, P, K, 2\), got \(3, 17, 3\)",
        ),
        "names": (lambda b: b.npz(joint_names=["a", "b"]), r"joint_names: expected 17 names, got"),
        "frames": (lambda b: b.npz(frames=np.arange(4)), r"frames: expected 3 whole numbers that ascend"),
    },
    "metrabs_ragged": {
        "one frame's joints": (
            lambda b: b.npz(poses2d=_ragged((2, 17, 2), (1, 16, 2), (2, 17, 2))),
            r"poses2d\[1\]: expected shape \(P, 17, 2\) like the other frames, got \(1, 16, 2\)",
        ),
        "code": (
            lambda b: b.npz(poses2d=np.array([Bomb()], dtype=object)),
            r"poses2d: expected NumPy arrays, numbers and builtin containers only, got .*print",
        ),
        "cut": NPZ_CUT,
    },
    "deeplabcut": {
        "cut": (
            lambda b: b.file.write_bytes(b.file.read_bytes()[:9000]),
            r"file: expected a complete HDF5 file of pandas",
        ),
        "no HDF5": (lambda b: b.file.write_text("x" * 99), r"file: expected a complete HDF5 file of pandas"),
        "an attribute": (_long_name, r"file: expected a complete HDF5 file of pandas, got .*attributes"),
        "key": (
            lambda b: b.dlc(lambda table: table[table.columns[0]].rename("x")),
            r"key: expected one table in the file \(df_with_missing or tracks\), got keys df_with_missing",
        ),
        "keys": (
            lambda b: b.dlc(lambda table: table, "df_with_missing", "tracks"),
            r"key: expected one table in the file .*, got tables df_with_missing, tracks",
        ),
        "levels": (
            lambda b: b.dlc(renamed),
            r"header: expected scorer/bodyparts/coords or .*, got scorer/parts/coords",
        ),
        "no x": (lambda b: b.dlc(without_x), r"nose\.x: expected a column, got none"),
        "likelihood": (
            lambda b: b.dlc(above_one),
            r"likelihood\[0, \d+\]: .*confidence in \[0, 1\], got 1\.5",
        ),
        "labels": (
            lambda b: b.dlc(lambda table: table.set_index([["a", "b", "c"]])),
            r"index: expected frame numbers \(results of a video\), got \['a'\]",
        ),
        "coords": (
            lambda b: b.dlc(lambda table: table.rename(columns={"likelihood": "z"})),
            r"coords: expected x, y, likelihood \(pixels\), got 'z'",
        ),
    },
    "deeplabcut_multi": {
        "other parts": (
            lambda b: b.dlc(
                lambda table: table.drop(
                    columns=[c for c in table.columns if c[1:3] == ("individual2", "nose")]
                )
            ),
            r"bodyparts: expected the same parts for every individual \(individual1, individual2\), got nose",
        ),
        "levels": (lambda b: b.dlc(renamed), r"header: .*got scorer/individuals/parts/coords"),
        "frames": (
            lambda b: b.dlc(lambda table: table.set_index(np.array([2, 1, 0]))),
            r"index: expected frame numbers that ascend",
        ),
    },
    "sleap": {
        "cut": (
            lambda b: b.file.write_bytes(b.file.read_bytes()[:3000]),
            r"file: expected a complete HDF5 file, got ",
        ),
        "no tracks": (
            lambda b: b.h5(lambda file: file.__delitem__("tracks")),
            r"tracks: expected a dataset under this key, got keys edge_inds, .*track_occupancy",
        ),
        "axes": (
            lambda b: b.h5(replaced("tracks", lambda old: np.moveaxis(old, 1, 3))),
            r"tracks: expected shape \(2, 2, 17, frames\), got \(2, 17, 3, 2\)",
        ),
        "scores of others": (
            lambda b: b.h5(replaced("point_scores", lambda old: old[:, :-1])),
            r"point_scores: expected shape \(2, 17, 3\) like the tracks, got \(2, 16, 3\)",
        ),
        "dims": (
            lambda b: b.h5(attr("tracks", "dims", '["frame", "x"]')),
            r"tracks\.dims: expected an order of track, xy, node, frame",
        ),
        "a wrong bit": (
            lambda b: b.file.write_bytes(b.file.read_bytes().replace(b"SNOD", b"SNOE")),
            r"file: expected a complete HDF5 file, got ",
        ),
        "names twice": (
            lambda b: b.h5(replaced("node_names", lambda old: np.repeat(old[:1], 17))),
            r"node_names: expected different names, got 'pelvis' twice",
        ),
    },
    "freemocap": {
        "cut": (Broken.cut, r"array: expected \d+ bytes .*, cut short"),
        "shape": (
            lambda b: np.save(b.file, np.zeros((2, 3, 553))),
            r"array: expected shape \(cameras, frames, points, 2\), got \(2, 3, 553\)",
        ),
        "points": (
            lambda b: np.save(b.file, np.zeros((2, 3, 40, 2))),
            r"array: expected one of 33, 75, 543, 553 points of MediaPipe, got 40",
        ),
        "cameras": (
            lambda b: np.save(b.file, np.zeros((3, 3, 33, 2))),
            r"views: expected 2 views for the cameras camA, camB, got 3 \(0, 1, 2\)",
        ),
        "code": (
            lambda b: np.save(b.file, np.array([Bomb()], dtype=object)),
            r"array: expected NumPy arrays, numbers and builtin containers only, got .*print",
        ),
    },
    "videopose3d": {
        "cut": NPZ_CUT,
        "no positions": (
            lambda b: b.npz(positions_2d=None),
            r"positions_2d: expected an array under this key",
        ),
        "no table": (
            lambda b: b.npz(positions_2d=np.zeros(3)),
            r"positions_2d: expected a table of sequences, got ndarray",
        ),
        "no list": (
            lambda b: b.npz(positions_2d={"S9": {"Directions 1": {}}}),
            r"positions_2d\.S9/Directions 1: expected a list of one array per camera, got dict",
        ),
        "joints": (
            lambda b: b.npz(positions_2d=videopose3d_table(np.full((T, 2, 1, 16, 3), 9.0))),
            r"positions_2d\.S9/Directions 1\[0\]: expected 17 joints \(metadata.layout_name\), got 16",
        ),
        "code": (lambda b: b.npz(positions_2d=Bomb()), r"positions_2d: expected NumPy arrays, .*got .*print"),
    },
    "npz": {
        "cut": NPZ_CUT,
        "no detections": (lambda b: b.npz(detections=None), r"detections: expected an array under this key"),
        "shape": (
            lambda b: b.npz(detections=np.zeros((T, 2, 3))),
            r"detections: expected shape \(T, M, P, K, 2 or 3\), P may be left out, got \(3, 2, 3\)",
        ),
        "cameras": (lambda b: b.npz(camera_names=["camA"]), r"camera_names: expected 2 names, got"),
        "confidence": (
            lambda b: b.npz(detections=b.array("detections") * 2.0),
            r"detections\[0, 0, 0, \d+\]: expected a confidence in \[0, 1\], got 1\.",
        ),
        "confidence twice": (
            lambda b: b.npz(confidence=np.ones((T, 2, 2, K))),
            r"confidence: expected .*pixels alone in detections, got",
        ),
    },
}


@pytest.mark.parametrize(("name", "twin"), [(name, twin) for name in MALFORMED for twin in MALFORMED[name]])
def test_a_malformed_file_is_named_with_its_field(tmp_path, capsys, name, twin):
    check(tmp_path, capsys, name, *MALFORMED[name][twin])


def test_every_format_has_three_twins():
    assert fewest_twins(MALFORMED) >= 3


def test_the_bomb_is_one():
    assert b"print" in pickle.dumps(Bomb())
