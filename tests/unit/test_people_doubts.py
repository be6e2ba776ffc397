"""Who is followed over time, and doubts on whether it is one person: given where it is not, else silent."""

from __future__ import annotations

import numpy as np
import pytest

import skelsplat as sk
from command_line import READ, read_report, succeed
from detection_cases import CASES
from detection_files import Take
from skelsplat import layouts, synthetic
from skelsplat.findings import FindingWarning
from skelsplat.io import read_detections, write_calibration
from skelsplat.layouts import mirror_images
from skelsplat.run import Job
from skelsplat.run.read import Inputs
from skelsplat.run.tracked import choose, follow_everybody
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


FPS = 50
FRAMES = 40


@pytest.fixture(scope="module")
def people():
    return shuffled(seen(crossing(FRAMES), RIG))


def follow(people, frames=None, limit="all"):
    """Follow people (T, M, P, 17, 3) of these frames."""
    frames = np.arange(len(people)) if frames is None else frames
    nobody = np.full((*people.shape[:2], 17, 3), np.nan)
    whole = Inputs(RIG, LAYOUT, nobody, np.zeros(people.shape[:2], dtype=bool), frames, fps=FPS)
    return follow_everybody(people, whole, Job("Calib.toml", "pose", people=limit))


@pytest.fixture(scope="module")
def everybody():
    """Two people in the order of their appearance: one walks, a larger one stands still."""
    walk, other = crossing(FRAMES)
    people = seen([walk, 1.15 * np.repeat(other[:1], FRAMES, axis=0)], RIG)
    return follow(people), people


def test_a_person_is_chosen_by_motion_size_number_and_place(everybody):
    found, people = everybody
    walks = next(one.person for one in found.people if np.isclose(one.detections[3], people[3, :, 0]).all())
    stands = str(1 - int(walks))
    x, y = people[0, 2, 0, 8, :2]
    choices = {"moves-most": walks, "largest": stands, "1": "1", f"cam3:{x:.1f},{y:.1f}": walks}
    for choice, expected in choices.items():
        with pytest.warns(FindingWarning, match=rf"\({choice}\): person {expected} of 2 people"):
            assert choose(found, choice).person == expected


def several_of(people, limit="all"):
    """Return the doubts of a run of people (T, M, P, 17, 3): those on everybody, and those on each."""
    everybody = follow(people, limit=limit)
    return everybody.whole.doubts, [one.doubts for one in everybody.people]


def test_who_is_seen_by_two_views_only_is_named(people):
    people = seen(crossing(FRAMES), RIG)
    people[:, 2:, 1] = np.nan
    _, found = several_of(shuffled(people))
    (doubt,) = [doubt for doubts in found for doubt in doubts]
    assert (doubt.kind, doubt.subject.cameras) == ("person_of_few_views", ("cam1", "cam2"))
    assert doubt.numbers["frames_seen"] == [FRAMES, FRAMES]


@pytest.mark.parametrize(("frames", "named"), [(160, True), (120, False)])
def test_who_never_moves_is_named(frames, named):
    walk, other = crossing(frames)
    _, found = several_of(seen([walk, np.repeat(other[:1], frames, axis=0)], RIG))
    assert [doubt.kind for doubts in found for doubt in doubts] == ["person_still"] * named


@pytest.mark.parametrize(("offset", "named"), [(0.0, True), (200.0, False)])
def test_a_reflection_is_named(offset, named):
    """In a mirror at y = 1.2 m; somebody who only moves alike is no reflection."""
    walk = crossing(FRAMES)[0]
    image = walk[:, mirror_images(17, LAYOUT.left_right)] * [1.0, -1.0, 1.0] + [0.0, 2400.0, 0.0]
    image += offset * np.sin(np.arange(FRAMES) / 5.0)[:, None, None] * [1.0, 0.0, 0.0]
    _, found = several_of(seen([walk, image], RIG))
    assert [doubt.kind for doubts in found for doubt in doubts] == ["person_mirrored"] * named


def test_whoever_comes_back_after_long_may_be_the_same(people):
    away = np.full((7 * FPS, *people.shape[1:]), np.nan)
    found = follow(np.concatenate([people[:20], away, people[20:]])).people
    notes = [[note.numbers for note in one.doubts if note.kind == "person_back"] for one in found]
    assert [len(own) for own in notes] == [0, 0, 1, 1]
    assert all(own[0]["before"] in (0, 1) and own[0]["last"] == 19 for own in notes[2:])


def strangers():
    """Return detections of somebody else in every view, on whom no two views agree."""
    people = seen(crossing(FRAMES, apart_mm=4000.0), RIG)[:, :, 1:]
    for view in range(4):
        people[:, view] = np.roll(people[:, view], 7 * view, axis=0)
        people[:, view, ..., :2] += [50.0 * view, 90.0 * view]
    return people


def test_people_who_are_left_out_are_counted(people):
    (doubt,), _ = several_of(np.concatenate([people, strangers()], axis=2))
    assert doubt.kind == "people_left_out"
    assert doubt.numbers["left_out_share"] == pytest.approx(1 / 3, abs=0.05)
    assert [remedy.setting for remedy in doubt.remedy] == ["layout"]


@pytest.mark.parametrize(
    ("views", "said"),
    [
        (4, r"cam4 40 of 40 frames\): exchanged cameras, .* skelsplat check-cameras looks for the cause"),
        (1, "cam2 0, .* no two views detect anybody in the same frame"),
        (0, "got no detections of people"),
    ],
)
def test_nobody_found_is_an_error_that_says_what_is_there(views, said):
    people = strangers()
    people[:, views:] = np.nan
    with pytest.raises(sk.DatasetError, match=f"pose: people: expected somebody on whom two views .*{said}"):
        several_of(people)
