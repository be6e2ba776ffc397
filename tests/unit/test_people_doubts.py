"""Doubts of a run on whether it follows one person: given where it does not, else silent."""

from __future__ import annotations

import numpy as np
import pytest

from command_line import READ, read_report, succeed
from detection_cases import CASES
from detection_files import Take
from skelsplat import layouts, synthetic
from skelsplat.io import read_detections, write_calibration
from skelsplat.run.bones import find_lengths
from skelsplat.synthetic import DetectionNoise
from two_people import LAYOUT, crossing, doubts_of, findings_of, seen, shuffled

RIG = synthetic.human36m_like()
NOISES = [
    DetectionNoise.good(),
    DetectionNoise.noisy(),
    DetectionNoise.occluded(2),
    DetectionNoise.occluded(3),
    DetectionNoise.occluded(3, hard=True),
]


@pytest.mark.parametrize("noise", NOISES[:4])
def test_of_a_sound_choice_the_other_person_is_named(noise):
    people = seen(crossing(), RIG, noise)
    (doubt,) = doubts_of(shuffled(people), RIG)
    assert doubt.startswith("2 people are visible in about the same number of views in ")
    assert "Check that the right one is followed (the one at cam1:" in doubt


@pytest.mark.parametrize("frames", [slice(12, None), slice(6, 9)])
def test_another_person_in_all_views_at_once_is_a_jump(frames):
    """Each file holds one person, and from one frame to the next another one."""
    people = seen(crossing(apart_mm=2500.0), RIG)
    people[frames, :, 0] = people[frames, :, 1]
    (doubt,) = doubts_of(people[:, :, :1], RIG, "entry:0")
    times = "once" if frames.stop is None else "2 times"
    assert doubt.startswith(f"The person jumps {times} from one frame to the next, by up to ")
    assert doubt.endswith("change to another person, or frames are missing or out of order.")


def test_lengths_that_vary_are_named_by_the_limb_that_varies_most():
    limbs, lengths = [(11, 12), (12, 13)], np.full((2, 100), 300.0)
    lengths[1, :22] = 550.0
    assert list(find_lengths(LAYOUT, limbs, 2, lengths, np.ones_like(lengths))) == []
    lengths[1, :23] = 550.0
    (doubt,) = find_lengths(LAYOUT, limbs, 2, lengths, np.ones_like(lengths))
    assert doubt.subject.joints == tuple(LAYOUT.joints[joint] for joint in limbs[1])
    assert doubt.numbers["range_mm"] == [300.0, 550.0]


@pytest.mark.parametrize("rig", [RIG, synthetic.ring(3), synthetic.ring(8)], ids=["four", "three", "eight"])
@pytest.mark.parametrize("noise", [NOISES[0], NOISES[3]], ids=["good", "occluded"])
@pytest.mark.parametrize("views", [slice(0, 1), slice(-2, None)], ids=["one", "two"])
def test_somebody_else_in_some_views_is_told_without_a_crowd(rig, noise, views):
    """Each file holds one person, but every other frame of one or two views somebody else."""
    people = seen(crossing(), rig, noise)
    assert not [doubt for doubt in findings_of(people[:, :, :1], rig, "entry:0") if doubt.startswith("In ")]
    people[::2, views, 0] = people[::2, views, 1]
    (doubt,) = (doubt for doubt in findings_of(people[:, :, :1], rig, "entry:0") if doubt.startswith("In "))
    if views == slice(0, 1) and len(rig) > 3:  # of two against two, nothing tells which are the others
        assert f"{rig.names[0]} in " in doubt


def test_a_detector_of_one_person_is_named_as_the_cause_where_views_show_different_people():
    layout, people = layouts.MEDIAPIPE33, seen(crossing(apart_mm=2500.0), RIG)
    joints = [name for name in layout.joints if name in LAYOUT.joints]
    one = np.full((*people.shape[:2], 1, layout.n_joints, 3), np.nan)
    here, there = ([where.joints.index(name) for name in joints] for where in (layout, LAYOUT))
    one[..., here, :] = people[:, :, :1, there]

    def causes():
        return [words for words in findings_of(one, RIG, layout=layout) if words.startswith("MediaPipe ")]

    assert not causes()
    one[:, 2:, :, here] = people[:, 2:, 1:2, there]  # two of the four follow somebody else
    assert len(causes()) == 1


def test_of_several_people_the_choice_is_doubted_and_another_is_offered(tmp_path):
    write_calibration(tmp_path / "Calib.toml", RIG)
    (tmp_path / "openpose").mkdir()
    take = Take(shuffled(seen(crossing(), RIG)), list(RIG.names), list(LAYOUT.joints))
    source = CASES["openpose"].write(tmp_path / "openpose", take)
    arguments = ["refine", tmp_path / "Calib.toml", source, "-o", tmp_path / "out", *READ, "--write", "csv"]

    def found(*options):
        succeed(*arguments, *options, "--no-html")
        return {one["kind"]: one for one in read_report(tmp_path / "out")["findings"]}

    assert {"person_by_place", "people_visible", "many_rejected"} <= set(found("--person", "entry:0"))
    assert set(found()) == {"people_visible"}
    place, frame = found("--fps", 50)["people_visible"]["numbers"]["followed"]
    followed = read_detections(tmp_path / "out" / "detections.npz", list(RIG.names), layout=LAYOUT).people
    x, y = map(float, place.partition(":")[2].split(","))
    at = followed[frame, RIG.names.index(place.partition(":")[0]), 0, :, :2]
    assert np.nanmin(np.hypot(*(at - (x, y)).T)) < 1  # a joint of the person, not just near
    for choice in (place, 0):
        assert set(found("--fps", 50, "--person", choice)) == {"person_followed"}
