"""Two people before four cameras, real detections in OpenPose's arbitrary order."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

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
