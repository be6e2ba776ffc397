"""Real detections: two people in OpenPose's arbitrary order; MVOR, an operating room, many half hidden."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

import skelsplat as sk
from command_line import read_report, succeed
from detection_cases import CASES
from detection_files import Take

OPTIONS = ["--unit", "m", "--layout", "body25b", "--no-html"]


@pytest.fixture(scope="module")
def trial(data, tmp_path_factory):
    """Return a folder with the calibration and the files of everybody."""
    folder = tmp_path_factory.mktemp("two")
    shutil.copy(data / "pose2sim_demo" / "Calib_qualisys.toml", folder)
    with np.load(data / "pose2sim_demo" / "pose2sim_demo.npz") as archive:
        people = archive["two_persons_det2d"].astype(float)
        cameras, joints = (archive[key].tolist() for key in ("camera_names", "kpt_names"))
    people[people[..., 2] <= 0] = np.nan
    (folder / "pose").mkdir()
    CASES["openpose"].write(folder / "pose", Take(people, cameras, joints))
    return folder


def doubts(trial, out, person, *more):
    """Return the numbers of a run's warnings, by kind."""
    files = [trial / "Calib_qualisys.toml", trial / "pose"]
    result = succeed("refine", *files, "-o", out, *OPTIONS, *more, "--person", person)
    assert max(len(line) for line in result.stdout.splitlines() if line.startswith("!")) <= 80
    return {finding["kind"]: finding["numbers"] for finding in read_report(out)["findings"]}


def test_the_first_entries_of_the_files_are_several_people(trial, tmp_path):
    found = doubts(trial, tmp_path, "entry:0")
    assert {"person_by_place", "times_assumed"} <= set(found)
    visible = found["people_visible"]
    assert (visible["people"], visible["share_of_frames"]) == (2, 1.0)
    # under kernels as wide as the scatter a mixed frame's pose lies between the two people: limbs are
    # shortened and fewer detections are rejected than if it kept to one of them
    assert found["limb_lengths_vary"]["relative_range"] > 0.5
    assert found["many_rejected"]["rejected_share"] >= 0.2


@pytest.mark.parametrize(("person", "more"), [("consistent", ["--fps", 60]), ("largest", [])])
def test_of_one_person_the_other_is_named(trial, tmp_path, person, more):
    found = doubts(trial, tmp_path, person, *more)
    visible = found["people_visible"]
    assert (visible["people"], visible["share_of_frames"]) == (2, 1.0)
    assert "limb_lengths_vary" not in found


def test_hard_data_are_outcomes(data):
    # of MVOR; which detection belongs to which person is taken from the ground truth
    with np.load(data / "mvor" / "mvor_days12.npz") as archive:
        mvor = dict(archive)
    size = tuple(int(s) for s in mvor["image_size"])
    cameras = [
        sk.Camera(K, w2c[:, :3], w2c[:, 3], size=size) for K, w2c in zip(mvor["K"], mvor["w2c"], strict=True)
    ]
    frames = []
    for f, person in np.argwhere((mvor["gt_match_openpose"] >= 0).sum(axis=-1) >= 2)[::6]:
        views = np.full((3, 17, 3), np.nan)
        for i, match in enumerate(mvor["gt_match_openpose"][f, person]):
            if match >= 0:
                views[i] = mvor["det2d_openpose"][f, i, match]
        frames.append(views)
    detections = np.array(frames, dtype=float)
    result = sk.refine(None, np.clip(detections, None, [np.inf, np.inf, 1.0]), cameras, layout="coco17")
    seen = (np.isfinite(detections).all(axis=-1) & (detections[..., 2] > 0)).sum(axis=1)
    assert ((result.joint_status == "unobserved") >= (seen == 0)).all()
    assert (np.isfinite(result.pose).all(axis=-1) | (seen < 2) | np.isnan(result.init_pose[..., 0])).all()
    ok = result.joint_status == "ok"
    assert np.isfinite(result.pose[ok]).all()
    assert ok.any()
