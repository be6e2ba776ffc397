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


NPZ_CUT = (Broken.cut, "file")
MALFORMED = {
    "rtmlib_frames": {
        "cut": NPZ_CUT,
        "no scores": (lambda b: b.npz(scores=None), "scores"),
        "no people axis": (lambda b: b.npz(keypoints=b.array("keypoints")[0]), "keypoints"),
        "scores of others": (lambda b: b.npz(scores=b.array("scores")[:, :-1]), "scores"),
    },
    "rtmlib_pairs": {
        "cut": (Broken.cut, "array"),
        "no scores": (lambda b: b.file.unlink(), "file"),
        "no npy": (lambda b: b.file.write_text("1 2 3"), "array"),
        "open bracket": (
            lambda b: b.file.write_bytes(b.file.read_bytes().replace(b"), }", b", } ", 1)),
            "array",
        ),
    },
    "rtmlib_cameras": {
        "frames": (lambda b: b.npz(frames=np.array([2, 1, 0])), "frames"),
        "one frame's": (
            lambda b: b.npz(keypoints=b.array("keypoints")[0], scores=b.array("scores")[0]),
            "keypoints",
        ),
        "cut": NPZ_CUT,
    },
    "metrabs": {
        "cut": NPZ_CUT,
        "no poses2d": (lambda b: b.npz(poses2d=None), "poses2d"),
        "3D": (lambda b: b.npz(poses2d=np.ones((T, K, 3))), "poses2d"),
        "names": (lambda b: b.npz(joint_names=["a", "b"]), "joint_names"),
        "frames": (lambda b: b.npz(frames=np.arange(4)), "frames"),
    },
    "metrabs_ragged": {
        "one frame's joints": (
            lambda b: b.npz(poses2d=_ragged((2, 17, 2), (1, 16, 2), (2, 17, 2))),
            r"poses2d\[1\]",
        ),
        "code": (lambda b: b.npz(poses2d=np.array([Bomb()], dtype=object)), "poses2d"),
        "cut": NPZ_CUT,
    },
    "deeplabcut": {
        "cut": (lambda b: b.file.write_bytes(b.file.read_bytes()[:9000]), "file"),
        "no HDF5": (lambda b: b.file.write_text("x" * 99), "file"),
        "an attribute": (_long_name, "file"),
        "key": (lambda b: b.dlc(lambda table: table[table.columns[0]].rename("x")), "key"),
        "levels": (lambda b: b.dlc(renamed), "header"),
        "no x": (lambda b: b.dlc(without_x), r"nose\.x"),
        "likelihood": (
            lambda b: b.dlc(above_one),
            r"likelihood\[0, \d+\]",
        ),
        "coords": (lambda b: b.dlc(lambda table: table.rename(columns={"likelihood": "z"})), "coords"),
    },
    "deeplabcut_multi": {
        "other parts": (
            lambda b: b.dlc(
                lambda table: table.drop(
                    columns=[c for c in table.columns if c[1:3] == ("individual2", "nose")]
                )
            ),
            "bodyparts",
        ),
        "frames": (lambda b: b.dlc(lambda table: table.set_index(np.array([2, 1, 0]))), "index"),
    },
    "sleap": {
        "cut": (lambda b: b.file.write_bytes(b.file.read_bytes()[:3000]), "file"),
        "no tracks": (lambda b: b.h5(lambda file: file.__delitem__("tracks")), "tracks"),
        "axes": (lambda b: b.h5(replaced("tracks", lambda old: np.moveaxis(old, 1, 3))), "tracks"),
        "scores of others": (
            lambda b: b.h5(replaced("point_scores", lambda old: old[:, :-1])),
            "point_scores",
        ),
        "dims": (lambda b: b.h5(attr("tracks", "dims", '["frame", "x"]')), r"tracks\.dims"),
        "names twice": (
            lambda b: b.h5(replaced("node_names", lambda old: np.repeat(old[:1], 17))),
            "node_names",
        ),
    },
    "freemocap": {
        "cut": (Broken.cut, "array"),
        "shape": (lambda b: np.save(b.file, np.zeros((2, 3, 553))), "array"),
        "points": (lambda b: np.save(b.file, np.zeros((2, 3, 40, 2))), "array"),
        "cameras": (lambda b: np.save(b.file, np.zeros((3, 3, 33, 2))), "views"),
        "code": (lambda b: np.save(b.file, np.array([Bomb()], dtype=object)), "array"),
    },
    "videopose3d": {
        "cut": NPZ_CUT,
        "no positions": (lambda b: b.npz(positions_2d=None), "positions_2d"),
        "no table": (lambda b: b.npz(positions_2d=np.zeros(3)), "positions_2d"),
        "joints": (
            lambda b: b.npz(positions_2d=videopose3d_table(np.full((T, 2, 1, 16, 3), 9.0))),
            r"positions_2d\.S9/Directions 1\[0\]",
        ),
        "code": (lambda b: b.npz(positions_2d=Bomb()), "positions_2d"),
    },
    "npz": {
        "cut": NPZ_CUT,
        "no detections": (lambda b: b.npz(detections=None), "detections"),
        "shape": (lambda b: b.npz(detections=np.zeros((T, 2, 3))), "detections"),
        "cameras": (lambda b: b.npz(camera_names=["camA"]), "camera_names"),
        "confidence": (
            lambda b: b.npz(detections=b.array("detections") * 2.0),
            r"detections\[0, 0, 0, \d+\]",
        ),
        "confidence twice": (lambda b: b.npz(confidence=np.ones((T, 2, 2, K))), "confidence"),
    },
}


@pytest.mark.parametrize(("name", "twin"), [(name, twin) for name in MALFORMED for twin in MALFORMED[name]])
def test_a_malformed_file_is_named_with_its_field(tmp_path, capsys, name, twin):
    check(tmp_path, capsys, name, *MALFORMED[name][twin])


def test_every_format_has_three_twins():
    assert fewest_twins(MALFORMED) >= 3


def test_the_bomb_is_one():
    assert b"print" in pickle.dumps(Bomb())
