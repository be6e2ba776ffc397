"""Malformed detections: one thing broken in a valid set, and the line that names file and field."""

from __future__ import annotations

import numpy as np
import pytest

import skelsplat as sk
from broken_detections import Broken, K, T
from detection_files import SCORER, videopose3d_table


class Bomb:
    def __reduce__(self):
        return (print, ("a pickle was run",))


def first(document):
    """Return the first person of MMPose's, EasyMocap's or COCO's."""
    if isinstance(document, list):
        return document[0]
    return document["annots"][0] if "annots" in document else document["instance_info"][0]["instances"][0]


def put(key, value):
    return lambda b: b.json(lambda document: first(document).__setitem__(key, value))


def drop(key):
    return lambda b: b.json(lambda document: first(document).pop(key) and None)


def above_one(table):
    table[table.columns[2]] = 1.5
    return table


def dataset(key, value):
    """Return a change of an h5 file that puts what `value` makes of a dataset in its place."""

    def change(file):
        old = file[key][()]
        del file[key]
        file[key] = value(old)

    return lambda b: b.h5(change)


def cut_text(characters):
    return lambda b: b.file.write_text(b.file.read_text()[:-characters])


def _ragged(*shapes):
    parts = np.empty(len(shapes), dtype=object)
    for t, shape in enumerate(shapes):
        parts[t] = np.full(shape, 5.0)
    return parts


JSON_CUT, NPZ_CUT, NPY_CUT = (Broken.cut, "JSON"), (Broken.cut, "file"), (Broken.cut, "array")
MALFORMED = {
    "easymocap": [
        JSON_CUT,
        (drop("keypoints"), r"annots\[0\]\.keypoints"),
        (put("keypoints", [[1.0, 2.0, 50.0]] * K), r"annots\[0\]\.keypoints\[0\]"),
    ],
    "mmpose": [
        JSON_CUT,
        (
            lambda b: b.json(lambda d: d["instance_info"][1].update(frame_id=0)),
            r"instance_info\[1\]\.frame_id",
        ),
        (put("keypoint_scores", [0.5] * 16), "keypoint_scores"),
    ],
    "alphapose": [
        JSON_CUT,
        (lambda b: b.file.write_text("[]"), "file"),
        (put("image_id", "a.jpg"), r"\[0\]\.image_id"),
    ],
    "coco": [(put("image_id", 20251121123456789012), r"\[0\]\.image_id")],
    "rtmlib_frames": [
        NPZ_CUT,
        (lambda b: b.npz(keypoints=b.array("keypoints")[0]), "keypoints"),
        (lambda b: b.npz(scores=b.array("scores")[:, :-1]), "scores"),
    ],
    "rtmlib_pairs": [NPY_CUT, (lambda b: b.file.unlink(), "file")],
    "rtmlib_cameras": [NPZ_CUT, (lambda b: b.npz(frames=np.array([2, 1, 0])), "frames")],
    "metrabs": [
        (lambda b: b.npz(poses2d=None), "poses2d"),
        (lambda b: b.npz(poses2d=np.ones((T, K, 3))), "poses2d"),
        (lambda b: b.npz(joint_names=["a", "b"]), "joint_names"),
    ],
    "metrabs_ragged": [
        (lambda b: b.npz(poses2d=_ragged((2, 17, 2), (1, 16, 2), (2, 17, 2))), "poses2d"),
        (lambda b: b.npz(poses2d=np.array([Bomb()], dtype=object)), "poses2d"),
    ],
    "deeplabcut": [
        (lambda b: b.dlc(lambda table: table[table.columns[0]].rename("x")), "key"),
        (lambda b: b.dlc(lambda table: table.rename_axis(columns={"bodyparts": "parts"})), "header"),
        (lambda b: b.dlc(lambda table: table.rename(columns={"likelihood": "z"})), "coords"),
    ],
    "deeplabcut_multi": [
        (lambda b: b.dlc(lambda table: table.drop(columns=[table.columns[0]])), r"pelvis\.x")
    ],
    "deeplabcut_csv": [
        (lambda b: b.text("\n0,", "\nimg0.png,"), "line 4"),
        (lambda b: b.file.write_text("".join(b.file.read_text().splitlines(keepends=True)[:3])), "index"),
        (lambda b: b.text(SCORER, "human"), "scorer"),
        (lambda b: b.dlc(above_one), "likelihood"),
    ],
    "sleap": [
        (lambda b: b.file.write_bytes(b.file.read_bytes()[:3000]), "file"),
        (dataset("point_scores", lambda old: old[:, :-1]), "point_scores"),
        (lambda b: b.h5(lambda file: file["tracks"].attrs.update(dims='["frame", "x"]')), "tracks"),
    ],
    "sleap_slp": [
        (lambda b: b.file.write_bytes(b.file.read_bytes()[:3000]), "file"),
        (lambda b: b.h5(lambda file: file.__delitem__("metadata")), "JSON"),
        (lambda b: b.h5(lambda file: file["metadata"].attrs.update(json="{}")), "skeletons"),
        (dataset("pred_points", lambda old: old[:-1]), r"instances\[\d+\]"),
    ],
    "ndx_pose": [
        (dataset("processing/behavior/camA/nose/data", lambda old: old[:, :1]), ".*/nose/data"),
        (dataset("processing/behavior/camA/nose/confidence", lambda old: old[1:]), ".*/nose/confidence"),
        (dataset("processing/behavior/camA/pelvis/timestamps", lambda old: old[::-1]), ".*/timestamps"),
        (lambda b: b.h5(lambda file: file.__delitem__("processing/behavior/camB/pelvis/timestamps")), "file"),
    ],
    "sleap_csv": [
        (cut_text(60), "line 7"),
        (lambda b: b.text("nose.y", "nose.z"), "line 1"),
        (lambda b: b.text("track_0,0,", "track_0,a,"), "line 2, frame_idx"),
        (lambda b: b.text(",0.9,", ",0.9,x"), r"line 2, head\.score"),
    ],
    "caliscope": [
        (lambda b: b.text("cam_id", "camera"), "camera"),
        (lambda b: b.text(",0,0,", ",0,99999,"), "joint"),
    ],
    "freemocap": [
        NPY_CUT,
        (lambda b: np.save(b.file, np.zeros((2, 3, 553))), "array"),
        (lambda b: np.save(b.file, np.zeros((3, 3, 33, 2))), "views"),
        (lambda b: np.save(b.file, np.array([Bomb()], dtype=object)), "array"),
    ],
    "videopose3d": [
        NPZ_CUT,
        (lambda b: b.npz(positions_2d=np.zeros(3)), "positions_2d"),
        (
            lambda b: b.npz(positions_2d=videopose3d_table(np.full((T, 2, 1, 16, 3), 9.0))),
            r"positions_2d\.S9\.Directions 1",
        ),
    ],
    "npz": [
        (lambda b: b.npz(detections=np.zeros((T, 2, 3))), "detections"),
        (lambda b: b.npz(camera_names=["camA"]), "camera_names"),
        (lambda b: b.npz(confidence=np.ones((T, 2, 2, K))), "confidence"),
    ],
    "wide_csv": [
        (cut_text(60), "line 4"),
        (lambda b: b.text("\n1,", "\n0,"), "line 3, frame"),
        (lambda b: b.replace("likelihood", "quality"), "line 1"),
        (lambda b: b.replace(",", ";"), "line 1"),
        (lambda b: b.text("\n0,0.0,", "\n0,0.0,a"), "line 2, pelvis_x"),
    ],
    "csv": [
        (lambda b: b.text("joint", "part"), "line 1"),
        (lambda b: b.text("pelvis,", "pelvis,a"), "line 2, x"),
        (lambda b: b.text("camA,0,", "camA,0.5,"), "line 2, frame"),
    ],
}
CASES = [(name, place) for name, faults in MALFORMED.items() for place in range(len(faults))]


@pytest.mark.parametrize(("name", "place"), CASES)
def test_a_malformed_file_is_named_with_its_field(tmp_path, capsys, name, place):
    change, field = MALFORMED[name][place]
    broken = Broken(tmp_path, name)
    assert broken.read().people.shape[3] == K
    change(broken)
    with pytest.raises(sk.DatasetError, match=rf"{field}(\[[\d, ]+\])?: expected") as caught:
        broken.read()
    assert caught.value.path == broken.file
    assert "\n" not in str(caught.value)
    assert capsys.readouterr().out == ""  # of a pickle that was run
