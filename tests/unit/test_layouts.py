"""Joint layouts: the built-in ones, layout files, and what names of joints say."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

import skelsplat as sk
from broken_detections import anybody, write_case
from command_line import assert_fails, invoke
from skelsplat import layouts, synthetic
from skelsplat.io import read_layout
from skelsplat.layouts import mirrored_names

H36M = layouts.H36M17


@pytest.mark.parametrize("name", layouts.names)
def test_every_layout_is_written_and_read_back_as_it_is(name, tmp_path):
    layout, path = layouts.get(name.upper()), tmp_path / "written.toml"
    layouts.write(path, name)
    assert layouts.read(path) == layout == layouts.get(path) == sk.Layout.by_name(str(path))
    assert layouts.about(path) == layouts.about(layout) == layouts.about(name)
    assert all(vars(layouts.about(name)).values())
    assert layouts.is_built_in(layout)
    assert layout.name == name
    assert re.search(r"\d+", name.removeprefix("h36m"))[0] == str(layout.n_joints)


# Indices that the tools publish, where orders are easily confused; pairs; whether they are a person's.
@pytest.mark.parametrize(
    ("name", "published", "pairs", "human"),
    [
        ("wholebody133", {17: "left_big_toe", 23: "face_0", 91: "left_hand_root"}, 61, True),
        ("halpe136", {17: "head", 19: "pelvis", 21: "right_big_toe", 94: "left_hand_root"}, 61, True),
        ("mouse22", {2: "nose", 7: "tail_end", 11: "left_shoulder", 21: "right_hip"}, 8, False),
        ("fly38", {0: "right_front_coxa", 15: "right_antenna", 37: "left_stripe3"}, 19, False),
    ],
)
def test_orders_are_the_published_ones(name, published, pairs, human):
    layout = layouts.get(name)
    assert {k: layout.joints[k] for k in published} == published
    assert (len(layout.left_right), layout.human) == (pairs, human)
    assert len({frozenset(limb) for limb in layout.limbs}) == len(layout.limbs)


MOUSE = """
name = "mouse"
joints = ["nose", "ear_l", "ear_r", "tail"]
limbs = [["nose", "ear_l"], ["nose", "ear_r"], ["nose", "tail"]]
bones = [{ joints = ["tail", "nose"], length_mm = 80 }, { joints = ["nose", "ear_l"] }]
root = ["nose"]

[angles]
left_ear = { joints = ["nose", "ear_l", "tail"] }
"head on body" = { joints = ["nose", "ear_l", "nose", "tail"], sign = -1, offset = 90 }
"""


def write(folder, text):
    path = folder / "mine.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_what_a_layout_file_leaves_out_follows_from_the_names(tmp_path):
    layout = layouts.read(write(tmp_path, MOUSE))
    assert layout.left_right == ((1, 2),)
    assert layout.symmetric == ((3, (0, 1), (0, 2)),)
    assert layout.lengths == (((0, 3), 80.0, 8.0),)
    assert layout.root == (0,)
    assert layout.angles == (("left_ear", (0, 1, 3), 1.0, 0.0), ("head on body", (0, 1, 0, 3), -1.0, 90.0))
    layouts.write(tmp_path / "again.toml", layout)
    assert layouts.read(tmp_path / "again.toml") == layout
    assert not layout.human
    bare = layouts.read(write(tmp_path, 'joints = ["a_l", "a_r"]\nleft_right = []'))
    assert (bare.name, bare.left_right, bare.limbs) == ("mine", (), ())


def test_lengths_of_a_layout_file_place_a_joint_that_one_view_sees(tmp_path):
    rig, pose = synthetic.ring(4), np.asarray(synthetic.motion("walk", 1, seed=4))
    seen = np.swapaxes(sk.project(pose, rig), 0, 1)
    wrist, elbow = (H36M.joints.index(f"left_{name}") for name in ("wrist", "elbow"))
    seen[:, 1:, wrist] = np.nan
    length = float(np.linalg.norm(pose[0, wrist] - pose[0, elbow]))
    path, given = tmp_path / "person.toml", {"limbs": H36M.limbs, "lengths": [((wrist, elbow), length, 5.0)]}
    layouts.write(path, sk.Layout("person", H36M.joints, **given))
    found = sk.refine(None, seen, rig, layout=str(path)).pose[0]
    assert np.linalg.norm(found[wrist] - found[elbow]) == pytest.approx(length, abs=5.0)


BEND = 'joints = ["a", "b"]\n[angles.bend]\njoints = [{}]\n'
LIMB = 'joints = ["a", "b"]\nlimbs = [["a", "b"]]\n'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('jonts = ["a"]', "jonts: expected one of name, .*, got an unknown key; did you mean joints?"),
        ('joints = "a"', "joints"),
        ('joints = ["a", "a"]', r"joints\[1\]"),
        ('joints = ["a"]\nlimbs = [["a", "b"]]', "limbs"),
        ('joints = ["a"]\nbones = [{ joint = 1 }]', r"bones\[0\].joint"),
        ('joints = ["a", "b"]\nbones = [{ joints = ["a", "b"], length_mm = 3 }]', "bones"),
        (LIMB + 'bones = [{ joints = ["a", "b"], length_mm = "3" }]', r"bones\[0\].length_mm"),
        (LIMB + 'bones = [{ joints = ["a", "b"], length_mm = 0 }]', "bones: expected a positive length"),
        ('name = "coco17"\njoints = ["a"]', "name: expected a name of its own, .*, got coco17"),
        (LIMB + "angles = 3", "angles: expected a table"),
        (LIMB + "[angles.bend]\nsign = 1", "angles.bend.joints: expected a list of strings, got nothing"),
        (BEND.format('"a", "b", "c"'), "angles.bend.joints: expected a joint of the layout, got 'c'"),
        (BEND.format('"a", "b", "a"') + "zero = 2", "angles.bend.zero: expected one of joints, sign, offset"),
        ('joints = ["a"', "TOML: expected valid TOML, got "),
    ],
)
def test_a_malformed_layout_file_is_named_with_its_field(tmp_path, text, message):
    path = write(tmp_path, text)
    with pytest.raises(sk.DatasetError, match=rf"^{re.escape(str(path))}: {message}"):
        layouts.get(path)


def test_an_unknown_layout_is_an_error_with_the_nearest_name(tmp_path):
    with pytest.raises(sk.InvalidInputError, match=r"layout: .*mouse22\?"):
        layouts.get("mouse2")
    with pytest.raises(sk.InvalidInputError, match="layout: expected a name, a path or a Layout, got int"):
        layouts.get(3)
    with pytest.raises(sk.DatasetError, match=r"gone\.toml: file"):
        layouts.get(tmp_path / "gone.toml")


@pytest.mark.parametrize(
    ("joints", "pairs"),
    [
        (["left_ear", "tail", "right_ear"], ((0, 2),)),
        (["REar", "LEar"], ((1, 0),)),
        (["Lear", "Rear", "rear"], ((0, 1),)),
        (["left_paw", "right_paw"], ((0, 1),)),
        (["FrontLeft", "HindRight", "FrontRight", "HindLeft"], ((0, 2), (3, 1))),
        (["FL", "FR", "RL", "RR", "HL_paw", "HR_paw"], ((0, 1), (2, 3), (4, 5))),
        (["frontleftpaw", "backrightpaw", "frontrightpaw", "backleftpaw"], ((0, 2), (3, 1))),
        (["flpaw", "frpaw", "pawhl", "hlpaw", "hrpaw", "pawhr"], ((0, 1), (3, 4))),  # one pair ends so
        (["LASI", "RASI", "SACR", "LPSI", "RPSI"], ((0, 1), (3, 4))),
        (["nose", "eyel", "eyer", "earl", "earr", "tail"], ((1, 2), (3, 4))),
        (["lip", "rip", "leye", "reye", "lear", "rear"], ((2, 3), (4, 5))),
        (["paw1LF", "paw2RF", "paw3LH", "paw4RH"], ((0, 1), (2, 3))),
        (["thumb_l_1", "thumb_r_2"], ()),
        (["FL", "FR", "LF", "RF"], ()),
        (["paw_l_1", "paw_r_1", "paw_l_2", "paw_r_2"], ((0, 1), (2, 3))),
        (["hip_left", "left_hip", "right_hip"], ()),  # which of the two?
    ],
)
def test_sides_are_read_from_names_where_they_are_unambiguous(joints, pairs):
    assert mirrored_names(joints) == pairs


def test_a_project_of_deeplabcut_is_a_layout(tmp_path):
    path = tmp_path / "config.yaml"
    path.write_text(
        "bodyparts:\n- snout\n- earL\n- earR\nskeleton:\n- - snout\n  - earL\n- - snout\n  - earR\n"
    )
    said = rf"{re.escape(str(path))}: 3 joints, 2 limbs, 1 left–right pairs by name \(earL–earR\)\."
    with pytest.warns(UserWarning, match=said):
        layout = read_layout(path)
    assert layout.limbs == ((0, 1), (0, 2))
    assert layout.symmetric == ((3, (0, 1), (0, 2)),)
    with pytest.raises(
        sk.InvalidInputError, match="layout: expected a name or a path, as there are no detections"
    ):
        read_layout("file")


def test_the_command_lists_and_explains(tmp_path, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    listed = invoke("layouts").stdout
    assert all(name in listed for name in layouts.names)
    assert [row["name"] for row in json.loads(invoke("layouts", "--json").stdout)] == list(layouts.names)
    assert invoke("layouts", "-q").stdout.split() == list(layouts.names)
    shown = invoke("layouts", "mouse22").stdout
    for part in ("mouse22, 22 joints. A mouse", "DANNCE", " 2 nose", "Limbs (21)", "tail_middle–tail_end"):
        assert part in shown
    (tmp_path / "own.toml").write_text(invoke("layouts", "mouse22", "--toml").stdout, encoding="utf-8")
    assert layouts.read(tmp_path / "own.toml") == layouts.get("mouse22")
    own = write(tmp_path, MOUSE)
    assert "Lengths of bones: nose–tail 80 ± 8 mm." in invoke("layouts", own).stdout
    document = json.loads(invoke("layouts", own, "--json").stdout)
    assert document["angles"][0] == {"name": "left_ear", "joints": [0, 1, 3], "sign": 1.0, "offset": 0.0}
    assert document["bones"] == [{"joints": [0, 3], "length_mm": 80.0, "sigma_mm": 8.0}]
    assert invoke("layouts", "hand21", "-q").stdout.split() == list(layouts.get("hand21").joints)
    (tmp_path / "dlc").mkdir()
    write_case(tmp_path / "dlc", "deeplabcut_csv", people=anybody())
    # a folder of detections, whose name becomes the layout's
    assert invoke("layouts", tmp_path / "dlc", "--toml").stdout.startswith('name = "dlc"\n\njoints = [')
    assert_fails(invoke("layouts", "body99"), 2, "NAME", "'body99'", "did you mean body25?")
    assert_fails(invoke("layouts", "--toml"), 2, "--toml")
