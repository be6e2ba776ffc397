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


JSON_CUT = (Broken.cut, r"JSON: expected a complete JSON document, got .* at character \d+ of \d+")
MALFORMED = {
    "easymocap": {
        "cut": JSON_CUT,
        "no annots": (lambda b: b.json(without("annots")), r"annots: expected a list of people, got nothing"),
        "annots no list": (lambda b: b.json(lambda d: d.update(annots={})), r"annots: .* a list .*got dict"),
        "no keypoints": (
            lambda b: b.json(drop(first, "keypoints")),
            r"annots\[0\]\.keypoints: expected a list of \[x, y, confidence\], got nothing",
        ),
        "two numbers": (
            lambda b: b.json(put(first, "keypoints", [[1.0, 2.0]])),
            r"annots\[0\]\.keypoints\[0\]: expected 3 numbers, got 2 numbers",
        ),
        "text": (
            lambda b: b.json(put(first, "keypoints", [[1.0, "2", 0.5]])),
            r"annots\[0\]\.keypoints\[0\]\[1\]: expected a number, got '2'",
        ),
        "confidence": (
            lambda b: b.json(put(first, "keypoints", [[1.0, 2.0, 50.0]] * K)),
            r"annots\[0\]\.keypoints\[0\]: expected a confidence in \[0, 1\], got 50",
        ),
        "joints": (
            lambda b: b.json(put(first, "keypoints", [[1.0, 2.0, 0.5]] * 25)),
            r"expected 17 joints \(layout h36m17\), got 25 \(body25 or body25b\)",
        ),
    },
    "mmpose": {
        "cut": JSON_CUT,
        "no instance_info": (
            lambda b: b.json(without("instance_info")),
            r"instance_info: expected a list of frames, got nothing",
        ),
        "no frame_id": (
            lambda b: b.json(lambda d: d["instance_info"][1].pop("frame_id") and None),
            r"instance_info\[1\]\.frame_id: expected a frame number, got nothing",
        ),
        "frame twice": (
            lambda b: b.json(lambda d: d["instance_info"][1].update(frame_id=0)),
            r"instance_info\[1\]\.frame_id: expected every frame once, got 0 again",
        ),
        "scores too few": (
            lambda b: b.json(put(first, "keypoint_scores", [0.5] * 16)),
            r"keypoint_scores: expected 17 numbers, one per keypoint, got 16 for 17 keypoints",
        ),
        "three numbers": (
            lambda b: b.json(put(first, "keypoints", [[1.0, 2.0, 3.0]] * K)),
            r"instances\[0\]\.keypoints\[0\]: expected 2 numbers, got 3 numbers",
        ),
        "names of another layout": (
            lambda b: b.json(
                lambda d: d["meta_info"].update(
                    keypoint_id2name=dict(zip(map(str, range(K)), sk.layouts.COCO17.joints, strict=True))
                )
            ),
            r"joint names: expected a name for every joint of h36m17, got none for pelvis, spine, neck, head",
        ),
        "names with a gap": (
            lambda b: b.json(lambda d: d["meta_info"]["keypoint_id2name"].pop("4") and None),
            r"meta_info\.keypoint_id2name: expected a name for each of 0 to 15",
        ),
    },
    "alphapose": {
        "cut": JSON_CUT,
        "an object": (
            lambda b: b.json(lambda d: {"a": d}),
            r"document: expected AlphaPose results.*got dict",
        ),
        "empty": (lambda b: b.file.write_text("[]"), r"document: .*got an empty list"),
        "no image": (lambda b: b.json(drop(entry, "image_id")), r"\[0\]\.image_id: .*got nothing"),
        "no number": (
            lambda b: b.json(put(entry, "image_id", "a.jpg")),
            r"\[0\]\.image_id: expected an image's name with a number.*got 'a\.jpg'",
        ),
        "20 digits": (
            lambda b: b.json(put(entry, "image_id", "20251121123456789012.jpg")),
            r"\[0\]\.image_id: expected a frame number below 2\^62, got 20251121123456789012",
        ),
        "one number too few": (
            lambda b: b.json(lambda d: d[0]["keypoints"].pop() and None),
            r"\[0\]\.keypoints: expected three numbers per joint, got 50 numbers",
        ),
        "joints": (
            lambda b: b.json(put(entry, "keypoints", [1.0] * 78)),
            r"\[0\]\.keypoints: expected 3·17 = 51 numbers \(layout h36m17\), got 78 \(3·26: halpe26\)",
        ),
    },
    "coco": {
        "cut": JSON_CUT,
        "annotations": (
            lambda b: b.json(lambda d: {"images": [], "annotations": d}),
            r"document: expected COCO keypoint results, a list of people, got dict",
        ),
        "visibility": (
            lambda b: b.json(lambda d: [{**p, "keypoints": [5.0, 6.0, 2] * K} for p in d]),
            r"keypoints: expected confidences of a detector, got visibility flags",
        ),
        "image_id": (
            lambda b: b.json(put(entry, "image_id", 1.5)),
            r"\[0\]\.image_id: expected a whole number from 0, got 1\.5",
        ),
        "image_id of 20 digits": (
            lambda b: b.json(put(entry, "image_id", 20251121123456789012)),
            r"\[0\]\.image_id: expected a frame number below 2\^62, got 20251121123456789012",
        ),
        "a number of 400 digits": (
            lambda b: b.json(lambda d: d[0]["keypoints"].__setitem__(4, 10**400)),
            r"\[0\]\.keypoints\[4\]: expected a number, got inf",
        ),
        "null": (
            lambda b: b.json(lambda d: d[0]["keypoints"].__setitem__(4, None)),
            r"\[0\]\.keypoints\[4\]: expected a number, got None",
        ),
    },
    "deeplabcut_csv": {
        "open quote": (
            lambda b: b.file.write_text(b.file.read_text().rstrip("\n") + ',"' + "1,2\n" * 60_000),
            r"line 6: expected comma-separated fields, every quote closed, got a quote that is not closed in",
        ),
        "a field without end": (
            lambda b: b.file.write_text(b.file.read_text().rstrip("\n") + 140_000 * "9"),
            r"line 6: expected fields of at most 131072 characters, got a longer one",
        ),
        "cut": (
            lambda b: b.file.write_text(b.file.read_text()[:-200]),
            r"line 6: expected 52 fields, got \d+ fields",
        ),
        "header": (
            lambda b: b.text("bodyparts", "parts"),
            r"header: expected scorer/bodyparts/coords or .*got scorer/parts/coords",
        ),
        "text": (lambda b: b.text("\n0,", "\n0,a"), r"line 4: expected a number or nothing, got 'a"),
        "labels": (lambda b: b.text("\n0,", "\nimg0.png,"), r"line 4: expected a frame number"),
        "frame of 20 digits": (
            lambda b: b.text("\n0,", f"\n{10**19},"),
            r"line 4: expected a frame number below 2\^62, got 1000",
        ),
        "no frames": (
            lambda b: b.file.write_text("".join(b.file.read_text().splitlines(keepends=True)[:3])),
            r"index: expected frame numbers that ascend, got none",
        ),
        "scorers": (lambda b: b.text(SCORER, "human"), r"scorer: expected one scorer, got DLC_.*, human"),
    },
    "deeplabcut_csv_multi": {
        "likelihood": (
            lambda b: b.dlc(above_one),
            r"likelihood\[0, \d+\]: .*confidence in \[0, 1\], got 1\.5",
        ),
        "no x": (lambda b: b.dlc(without_x), r"nose\.x: expected a column, got none"),
        "cut": (
            lambda b: b.file.write_text(b.file.read_text()[:-200]),
            r"line 7: expected \d+ fields, got \d+ fields",
        ),
    },
    "sleap_csv": {
        "header": (
            lambda b: b.text("nose.y", "nose.z"),
            r"line 1: expected the columns frame_idx, and NODE\.x and NODE\.y for every node, got",
        ),
        "a track twice": (
            lambda b: b.text("track_1,0,", "track_0,0,"),
            r"line 3, track: expected a track once per frame, got track_0 again in frame 0",
        ),
        "frame": (
            lambda b: b.text("track_0,0,", "track_0,a,"),
            r"line 2, frame_idx: expected a frame number, a whole number from 0, got 'a'",
        ),
        "text": (
            lambda b: b.text(",0.9,", ",0.9,x"),
            r"line 2, head\.score: expected a number or nothing, got",
        ),
        "cut": (lambda b: b.file.write_text(b.file.read_text()[:-60]), r"line 7: expected 54 fields, got"),
        "no lines": (
            lambda b: b.file.write_text(b.file.read_text().splitlines()[0]),
            r"lines: expected one line per animal and frame after the header, got none",
        ),
    },
    "caliscope": {
        "camera": (lambda b: b.text("cam_id", "camera"), r"line 1: expected a column cam_id, got sync_index"),
        "point": (
            lambda b: b.text("keypoint_id", "joint"),
            r"line 1: expected a column keypoint_id, got sync",
        ),
        "point twice": (
            lambda b: b.file.write_text(b.file.read_text() + b.file.read_text().splitlines()[1]),
            r"line 206, point: expected a point once per camera, sync_index and object_id, got 0 again",
        ),
        "a point far up": (
            lambda b: b.text(",0,0,", ",0,99999,"),
            r"line 2, point: expected numbers from 0 to 9999, got 99999",
        ),
        "frame": (lambda b: b.text("\n0,", "\n0.5,"), r"line 2, sync_index: expected a frame number"),
        "cut": (lambda b: b.file.write_text(b.file.read_text()[:-40]), r"line 205: expected 10 fields, got"),
    },
    "csv": {
        "two people": (
            lambda b: b.text(",person,", ",who,"),
            r"line 19, joint: expected .*, or a column person for several, got 'pelvis' again in frame 0",
        ),
        "open quote": (
            lambda b: b.text("pelvis,", '"pelvis,'),
            r"line 2: expected comma-separated fields, every quote closed, got a quote that is not closed in",
        ),
        "a quote that another one closes": (
            lambda b: (b.text("spine,", '"spine,'), b.text("nose,", '"nose",')),
            r"line 9: expected .*, every quote closed, got a quote that is not closed in this line",
        ),
        "a quote in the last line": (
            lambda b: b.file.write_text(b.file.read_text().rstrip("\n") + '\ncamA,"'),
            r"line 206: expected .*, every quote closed, got a quote that is not closed in this line",
        ),
        "text behind a quote": (
            lambda b: b.text("pelvis,", '"pelvis" ,'),
            r"line 2: expected .*, every quote closed, got ',' expected after '\"'",
        ),
        "header": (
            lambda b: b.text("joint", "part"),
            r"line 1: expected the columns frame, joint, x, y, got",
        ),
        "a column twice": (
            lambda b: b.text("joint,x", "x,x"),
            r"line 1: expected the columns frame, joint, x, y, got",
        ),
        "another column twice": (
            lambda b: b.file.write_text(
                "\n".join(f"{line},a,a" for line in b.file.read_text().splitlines()) + "\n"
            ),
            r"line 1: expected every column once, got .*a, a$",
        ),
        "one field": (
            lambda b: b.file.write_text(f"{b.file.read_text()}end"),
            r"expected 7 fields, got 1 field$",
        ),
        "text": (lambda b: b.text("pelvis,", "pelvis,a"), r"line 2, x: expected a number or nothing, got 'a"),
        "cut": (lambda b: b.file.write_text(b.file.read_text()[:-60]), r"line 205: expected 7 fields, got"),
        "twice": (
            lambda b: b.file.write_text(b.file.read_text() + b.file.read_text().splitlines()[1]),
            r"line 206, joint: expected a joint, once per person, got 'pelvis'",
        ),
        "frame": (
            lambda b: b.text("camA,0,", "camA,0.5,"),
            r"line 2, frame: expected a frame number, a whole number from 0",
        ),
        "frame of 5000 digits": (
            lambda b: b.text("camA,0,", f"camA,{5000 * '9'},"),
            r"line 2, frame: expected a frame number below 2\^62, got 999",
        ),
        "places and names": (
            lambda b: b.text("pelvis", "0"),
            r"joint: expected names or places, not both, got places and right_hip",
        ),
    },
}


@pytest.mark.parametrize(("name", "twin"), [(name, twin) for name in MALFORMED for twin in MALFORMED[name]])
def test_a_malformed_file_is_named_with_its_field(tmp_path, capsys, name, twin):
    check(tmp_path, capsys, name, *MALFORMED[name][twin])


def test_every_format_has_three_twins():
    assert fewest_twins(MALFORMED) >= 3
