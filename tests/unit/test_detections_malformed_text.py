"""Malformed detections in JSON and csv: one thing broken in a valid set, and the line that says so."""

from __future__ import annotations

import pytest

import skelsplat as sk
from broken_detections import Broken, K, above_one, check, fewest_twins, without_x
from detection_files import SCORER


def without(key):
    return lambda document: {k: v for k, v in document.items() if k != key}


def first(document):
    """Return the first person of MMPose's or EasyMocap's."""
    if "annots" in document:
        return document["annots"][0]
    return document["instance_info"][0]["instances"][0]


def put(target, key, value):
    """Return a change of the first person that sets `key`."""

    def change(document):
        target(document)[key] = value

    return change


def drop(target, key):
    return lambda document: target(document).pop(key) and None


def entry(document):
    return document[0]


JSON_CUT = (Broken.cut, "JSON")
MALFORMED = {
    "easymocap": {
        "cut": JSON_CUT,
        "no annots": (lambda b: b.json(without("annots")), "annots"),
        "no keypoints": (lambda b: b.json(drop(first, "keypoints")), r"annots\[0\]\.keypoints"),
        "confidence": (
            lambda b: b.json(put(first, "keypoints", [[1.0, 2.0, 50.0]] * K)),
            r"annots\[0\]\.keypoints\[0\]",
        ),
        "joints": (
            lambda b: b.json(put(first, "keypoints", [[1.0, 2.0, 0.5]] * 25)),
            r"annots\[0\]\.keypoints",
        ),
    },
    "mmpose": {
        "cut": JSON_CUT,
        "no frame_id": (
            lambda b: b.json(lambda d: d["instance_info"][1].pop("frame_id") and None),
            r"instance_info\[1\]\.frame_id",
        ),
        "frame twice": (
            lambda b: b.json(lambda d: d["instance_info"][1].update(frame_id=0)),
            r"instance_info\[1\]\.frame_id",
        ),
        "scores too few": (lambda b: b.json(put(first, "keypoint_scores", [0.5] * 16)), "keypoint_scores"),
        "names of another layout": (
            lambda b: b.json(
                lambda d: d["meta_info"].update(
                    keypoint_id2name=dict(zip(map(str, range(K)), sk.layouts.COCO17.joints, strict=True))
                )
            ),
            "joint names",
        ),
    },
    "alphapose": {
        "cut": JSON_CUT,
        "an object": (lambda b: b.json(lambda d: {"a": d}), "document"),
        "empty": (lambda b: b.file.write_text("[]"), "document"),
        "no image": (lambda b: b.json(drop(entry, "image_id")), r"\[0\]\.image_id"),
        "no number": (lambda b: b.json(put(entry, "image_id", "a.jpg")), r"\[0\]\.image_id"),
    },
    "coco": {
        "cut": JSON_CUT,
        "annotations": (lambda b: b.json(lambda d: {"images": [], "annotations": d}), "document"),
        "visibility": (
            lambda b: b.json(lambda d: [{**p, "keypoints": [5.0, 6.0, 2] * K} for p in d]),
            "keypoints",
        ),
        "image_id": (lambda b: b.json(put(entry, "image_id", 1.5)), r"\[0\]\.image_id"),
        "image_id of 20 digits": (
            lambda b: b.json(put(entry, "image_id", 20251121123456789012)),
            r"\[0\]\.image_id",
        ),
    },
    "deeplabcut_csv": {
        "open quote": (
            lambda b: b.file.write_text(b.file.read_text().rstrip("\n") + ',"' + "1,2\n" * 60_000),
            "line 6",
        ),
        "cut": (lambda b: b.file.write_text(b.file.read_text()[:-200]), "line 6"),
        "header": (lambda b: b.text("bodyparts", "parts"), "header"),
        "text": (lambda b: b.text("\n0,", "\n0,a"), "line 4"),
        "labels": (lambda b: b.text("\n0,", "\nimg0.png,"), "line 4"),
        "no frames": (
            lambda b: b.file.write_text("".join(b.file.read_text().splitlines(keepends=True)[:3])),
            "index",
        ),
        "scorers": (lambda b: b.text(SCORER, "human"), "scorer"),
    },
    "deeplabcut_csv_multi": {
        "likelihood": (
            lambda b: b.dlc(above_one),
            r"likelihood\[0, \d+\]",
        ),
        "no x": (lambda b: b.dlc(without_x), r"nose\.x"),
        "cut": (lambda b: b.file.write_text(b.file.read_text()[:-200]), "line 7"),
    },
    "sleap_csv": {
        "header": (lambda b: b.text("nose.y", "nose.z"), "line 1"),
        "a track twice": (lambda b: b.text("track_1,0,", "track_0,0,"), "line 3, track"),
        "frame": (lambda b: b.text("track_0,0,", "track_0,a,"), "line 2, frame_idx"),
        "text": (lambda b: b.text(",0.9,", ",0.9,x"), r"line 2, head\.score"),
        "cut": (lambda b: b.file.write_text(b.file.read_text()[:-60]), "line 7"),
        "no lines": (lambda b: b.file.write_text(b.file.read_text().splitlines()[0]), "lines"),
    },
    "caliscope": {
        "camera": (lambda b: b.text("cam_id", "camera"), "line 1"),
        "point": (lambda b: b.text("keypoint_id", "joint"), "line 1"),
        "point twice": (
            lambda b: b.file.write_text(b.file.read_text() + b.file.read_text().splitlines()[1]),
            "line 206, point",
        ),
        "a point far up": (lambda b: b.text(",0,0,", ",0,99999,"), "line 2, point"),
        "frame": (lambda b: b.text("\n0,", "\n0.5,"), "line 2, sync_index"),
        "cut": (lambda b: b.file.write_text(b.file.read_text()[:-40]), "line 205"),
    },
    "csv": {
        "two people": (lambda b: b.text(",person,", ",who,"), "line 19, joint"),
        "open quote": (lambda b: b.text("pelvis,", '"pelvis,'), "line 2"),
        "header": (lambda b: b.text("joint", "part"), "line 1"),
        "a column twice": (lambda b: b.text("joint,x", "x,x"), "line 1"),
        "one field": (
            lambda b: b.file.write_text(f"{b.file.read_text()}end"),
            r"line \d+",
        ),
        "text": (lambda b: b.text("pelvis,", "pelvis,a"), "line 2, x"),
        "cut": (lambda b: b.file.write_text(b.file.read_text()[:-60]), "line 205"),
        "twice": (
            lambda b: b.file.write_text(b.file.read_text() + b.file.read_text().splitlines()[1]),
            "line 206, joint",
        ),
        "frame": (lambda b: b.text("camA,0,", "camA,0.5,"), "line 2, frame"),
        "places and names": (lambda b: b.text("pelvis", "0"), "joint"),
    },
}


@pytest.mark.parametrize(("name", "twin"), [(name, twin) for name in MALFORMED for twin in MALFORMED[name]])
def test_a_malformed_file_is_named_with_its_field(tmp_path, capsys, name, twin):
    check(tmp_path, capsys, name, *MALFORMED[name][twin])


def test_every_format_has_three_twins():
    assert fewest_twins(MALFORMED) >= 3
