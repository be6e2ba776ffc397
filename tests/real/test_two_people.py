"""Two people before four cameras, real detections in OpenPose's arbitrary order."""

from __future__ import annotations

import re
import shutil

import numpy as np
import pytest

from command_line import invoke, read_report, texts
from detection_cases import CASES
from detection_files import Take

OPTIONS = ["--unit", "m", "--layout", "body25b", "--no-html"]
IN_TIME = ["--fps", 60]


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
    arguments = [
        trial / "Calib_qualisys.toml",
        trial / "pose",
        "-o",
        out,
        *OPTIONS,
        *more,
        "--person",
        person,
    ]
    result = invoke("refine", *arguments)
    assert result.exit_code == 0, result.output
    assert max(len(line) for line in result.stdout.splitlines() if line.startswith("!")) <= 80
    return texts(read_report(out))


def test_the_first_entries_of_the_files_are_several_people(trial, tmp_path):
    place, rate, mixes, visible, lengths, rejected, *_ = doubts(trial, tmp_path, "0")
    assert place.startswith("--person 0 is entry 0 of each file, as the frame rate is unknown. ")
    assert rate.startswith("--fps is not given: ")
    assert mixes.startswith("--person 0 mixes people: the views show different people in 84% of the frames")
    assert visible.startswith(
        "2 people are visible in about the same number of views in 100% of the frames; "
    )
    # under kernels as wide as the scatter a mixed frame's pose lies between the two people: limbs are
    # shortened and fewer detections are rejected than if it kept to one of them
    varies = re.match(
        r"Limb lengths vary by up to (\d+)% over the recording, which is impossible for one body\. ", lengths
    )
    assert varies is not None
    assert int(varies[1]) > 50
    share = re.match(r"(\d+)% of all detections are rejected: check that all views show the same ", rejected)
    assert share is not None
    assert int(share[1]) >= 20


@pytest.mark.parametrize(("person", "more"), [("consistent", IN_TIME), ("largest", [])])
def test_of_one_person_the_other_is_named(trial, tmp_path, person, more):
    about = [
        one for one in doubts(trial, tmp_path, person, *more) if "people" in one or "Limb lengths" in one
    ]
    (visible,) = about
    assert visible.startswith(
        "2 people are visible in about the same number of views in 100% of the frames. "
    )
