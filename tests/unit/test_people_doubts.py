"""Doubts of a run that mixes people: given where it does, and silent where it does not."""

from __future__ import annotations

import re
from types import SimpleNamespace

import numpy as np
import pytest

from command_line import READ, invoke, read_report, texts
from detection_cases import CASES
from detection_files import Take
from skelsplat import synthetic
from skelsplat.io import read_detections, write_calibration
from skelsplat.run.people import LimbSpread, find_lengths
from skelsplat.synthetic import DetectionNoise
from two_people import LAYOUT, crossing, crowd_of, doubts_of, findings_of, seen, shuffled

RIG = synthetic.human36m_like()
VISIBLE = "2 people are visible in about the same number of views in 100% of the frames"
NOISES = [
    DetectionNoise.good(),
    DetectionNoise.noisy(),
    DetectionNoise.occluded(2),
    DetectionNoise.occluded(3),
    DetectionNoise.occluded(3, hard=True),
]


def test_entries_in_any_order_mix_people():
    """Limbs hardly vary: where no two views agree joints are weak, and weak joints do not count."""
    mixes, visible = doubts_of(shuffled(seen(crossing(), RIG)), RIG, "0")
    assert "mixes people: the views show different people in " in mixes
    assert visible.startswith(VISIBLE)


def test_a_change_alone_is_told():
    people = seen(crossing(), RIG)
    people[-4:] = people[-4:, :, ::-1].copy()
    mixes, visible = doubts_of(people, RIG, "1")
    assert "mixes people: it changes to another person in 1 of 23 steps from frame to frame" in mixes
    assert visible.startswith(VISIBLE)


@pytest.mark.parametrize("noise", NOISES[:4])
def test_of_a_sound_choice_the_other_person_is_named(noise):
    people = seen(crossing(), RIG, noise)
    (doubt,) = doubts_of(shuffled(people), RIG)
    assert doubt.startswith("2 people are visible in about the same number of views in ")
    assert "Check that the right one is followed (the one at cam1:" in doubt
    (of_entries,) = doubts_of(people, RIG, "1")  # a tracker's entries
    assert re.sub("cam1:[0-9,]+", "", of_entries) == re.sub("cam1:[0-9,]+", "", doubt)


@pytest.mark.parametrize("frames", [slice(12, None), slice(6, 9)])
def test_another_person_in_all_views_at_once_is_a_jump(frames):
    """Each file holds one person, and from one frame to the next another one."""
    people = seen(crossing(apart_mm=2500.0), RIG)
    people[frames, :, 0] = people[frames, :, 1]
    (doubt,) = doubts_of(people[:, :, :1], RIG, "0")
    times = "once" if frames.stop is None else "2 times"
    assert doubt.startswith(f"The person jumps {times} from one frame to the next, by up to ")
    assert doubt.endswith("change to another person, or frames are missing or out of order.")


def jumps(people, fps=None):
    """Return the findings on jumps of a recording with one person per file."""
    found = findings_of(people[:, :, :1], RIG, "0", fps=fps)
    return [text for text in found if text.startswith("The person jumps")]


@pytest.mark.parametrize("fps", [None, 60.0])
def test_frames_out_of_order_are_jumps(fps):
    people = seen(crossing(), RIG)
    (found,) = jumps(people[[*range(6), *range(18, 24), *range(6, 18)]], fps)
    assert "jumps 2 times from one frame to the next" in found
    assert "(frames 6, 12)" in found


def spread(off):
    """Of two limbs of H36M17; the second one varies more."""
    limbs = np.array([(11, 12), (12, 13)])
    return LimbSpread(
        limbs, np.array([300.0, 250.0]), np.array([290.0, 200.0]), np.array([320.0, 400.0]), off
    )


def test_lengths_that_vary_are_named_by_the_limb_that_varies_most():
    alone = SimpleNamespace(person="0", crowd=None, layout=LAYOUT, rig=RIG)
    assert list(find_lengths(alone, spread(0.11))) == []
    (doubt,) = (finding.text for finding in find_lengths(alone, spread(0.12)))
    assert doubt.startswith(
        "Limb lengths vary by up to 80% over the recording, which is impossible for one body. left_elbow to "
    )
    assert (
        "is 200 to 400 mm long (5th to 95th percentile), and 12% of the lengths of arms and legs deviate"
        in doubt
    )
    assert "Either the views show different people, or most views are wrong about these joints" in doubt
    crowd = crowd_of(shuffled(seen(crossing(), RIG)), RIG, "0")
    mixed = SimpleNamespace(person="0", crowd=crowd, layout=LAYOUT, rig=RIG)
    (doubt,) = (finding.text for finding in find_lengths(mixed, spread(0.12)))
    assert "The detections probably mix people" in doubt


@pytest.mark.parametrize("rig", [RIG, synthetic.ring(3), synthetic.ring(8)], ids=["four", "three", "eight"])
@pytest.mark.parametrize("noise", [NOISES[0], NOISES[3]], ids=["good", "occluded"])
@pytest.mark.parametrize("views", [slice(0, 1), slice(-2, None)], ids=["one", "two"])
def test_somebody_else_in_some_views_is_told_without_a_crowd(rig, noise, views):
    """Each file holds one person, but every other frame of one or two views somebody else."""
    people = seen(crossing(), rig, noise)
    assert not [doubt for doubt in findings_of(people[:, :, :1], rig, "0") if doubt.startswith("In ")]
    people[::2, views, 0] = people[::2, views, 1]
    (doubt,) = (doubt for doubt in findings_of(people[:, :, :1], rig, "0") if doubt.startswith("In "))
    assert "% of the frames, one camera's detections are far from the whole pose (" in doubt
    if views == slice(0, 1) and len(rig) > 3:  # of two against two, nothing tells which are the others
        assert f"{rig.names[0]} in " in doubt
    assert (
        "In these frames the cameras show different people or different moments, or a calibration is wrong: "
        in doubt
    )


def test_a_run_that_mixes_people_ends_well_and_says_so(tmp_path):
    write_calibration(tmp_path / "Calib.toml", RIG)
    (tmp_path / "openpose").mkdir()
    people = shuffled(seen(crossing(), RIG))
    source = CASES["openpose"].write(
        tmp_path / "openpose", Take(people, list(RIG.names), list(LAYOUT.joints))
    )
    arguments = ["refine", tmp_path / "Calib.toml", source, "-o", tmp_path / "out", *READ, "--write", "csv"]
    result = invoke(*arguments, "--person", 0)
    assert result.exit_code == 0, result.output
    text = " ".join(result.stdout.split())
    doubts = texts(read_report(tmp_path / "out"))
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    for start in ("Following person 0 mixes people: ", "2 people are visible"):
        assert sum(doubt.startswith(start) for doubt in doubts) == 1
        assert f"! {start}" in text
        assert start.strip() in page
    assert "of all detections are rejected: check that all views show the same person, then" in text
    assert "warning: Person 0 is entry 0 of each file, as the frame rate is unknown." in result.stderr
    result = invoke(*arguments)
    assert [doubt.split(" in ")[0] for doubt in report_doubts(tmp_path)] == ["2 people are visible"]
    assert invoke(*arguments, "--fps", 50).exit_code == 0
    (doubt,) = (doubt for doubt in report_doubts(tmp_path) if "people are visible" in doubt)
    place = re.search(r"followed \(the one at (cam\w+:\d+,\d+) in frame 0\)", doubt)[1]
    followed = read_detections(tmp_path / "out" / "detections.npz", list(RIG.names), layout=LAYOUT).people
    x, y = map(float, place.partition(":")[2].split(","))
    at = followed[0, RIG.names.index(place.partition(":")[0]), 0, :, :2]
    assert np.nanmin(np.hypot(*(at - (x, y)).T)) < 1  # a joint of the person, not just near
    assert invoke(*arguments, "--fps", 50, "--person", place).exit_code == 0
    assert invoke(*arguments, "--fps", 50, "--person", 0).exit_code == 0
    (note,) = texts(read_report(tmp_path / "out"), "note")
    assert "person 0 of 2 people" in note
    assert report_doubts(tmp_path) == []


def report_doubts(folder):
    return texts(read_report(folder / "out"))
