"""A rig without a fault must not be accused; unit, convention, geometry and cameras that repeat images."""

from __future__ import annotations

import numpy as np
import pytest

import skelsplat as sk
from rig_case import LAYOUT, T, detections, only, replaced, rig, turned
from skelsplat import synthetic
from skelsplat._frozen import frozen
from skelsplat.cameras import altered
from skelsplat.cameras import matrix_from_vector as rotation
from skelsplat.findings import FindingWarning
from skelsplat.rig_check import check_rig
from sweeps import diagonal, swept


@pytest.mark.parametrize(
    ("name", "motion", "noise"),
    diagonal(
        ("room", "dome of 3", "dome of 6", "pair"), ("walk", "sit", "reach"), ("good", "noisy", "occluded")
    ),
)
def test_a_sound_rig_is_not_accused(name, motion, noise):
    report = check_rig(rig(name), detections(name, motion, noise), layout=LAYOUT)
    assert report.ok, [finding.text for finding in report.findings]
    assert [row.name for row in report.cameras] == list(rig(name).names)


@pytest.mark.parametrize(("name", "unit"), [("room", "m"), ("pair", "cm")])
def test_a_wrong_unit_is_named(name, unit):
    finding = only(check_rig(sk.CameraRig(list(rig(name)), unit=unit), detections(name)))
    assert (finding.kind, finding.severity, finding.numbers["likely"]) == ("unit_wrong", "error", "mm")


def scaled(by, unit):
    made = [altered(camera, t=np.asarray(camera.t) * by) for camera in rig("room")]
    return sk.CameraRig(made, unit=unit)


def test_a_scale_that_is_no_unit_is_named():
    finding = only(check_rig(scaled(30.0, "m"), detections("room")))
    assert (finding.kind, finding.severity, finding.numbers["likely"]) == ("unit_wrong", "error", None)
    assert "e+" not in finding.text


def test_an_animal_need_not_have_a_person_s_size():
    human, mouse = sk.layouts.H36M17, scaled(0.05, "mm")
    own = sk.Layout("mouse", human.joints, limbs=human.limbs, left_right=human.left_right)
    assert check_rig(mouse, detections("room"), layout=own).ok
    assert only(check_rig(mouse, detections("room"), layout=human)).severity == "error"
    assert check_rig(scaled(1e-6, "mm"), detections("room"), layout=own).ok
    finding = only(check_rig(scaled(0.05, "m"), detections("room"), layout=own))
    assert (finding.kind, finding.severity) == ("unit_wrong", "warning")


@pytest.mark.parametrize(
    ("name", "degrees", "mm"),
    [
        ("room", 10, 500),
        ("dome of 3", 10, 500),
        swept("room", 5, 100),
        swept("dome of 6", 5, 100),
        swept("dome of 6", 10, 500),
    ],
)
def test_a_calibration_of_another_recording_is_named_once(name, degrees, mm):
    """Every camera was set up anew, turned and moved by about so much."""
    random = np.random.default_rng(0)
    cameras = rig(name)
    for view, camera in enumerate(rig(name)):
        axis = random.normal(size=3)
        R = rotation(np.radians(degrees) * axis / np.linalg.norm(axis)) @ np.asarray(camera.R)
        centre = np.asarray(camera.centre) + mm / np.sqrt(3.0) * random.normal(size=3)
        cameras = replaced(cameras, view, R=R, t=-R @ centre)
    finding = only(check_rig(cameras, detections(name), layout=LAYOUT))
    assert finding.kind == "recording_other"
    assert 2 * len(finding.subject.cameras) >= len(cameras)


def test_a_camera_that_sees_something_else_disagrees():
    found = detections("dome of 6").copy()
    found[:, 5, :, :2] = np.random.default_rng(0).uniform(0, 1000, found[:, 5, :, :2].shape)
    report = check_rig(rig("dome of 6"), found)
    finding = only(report)
    assert (finding.kind, finding.subject.cameras) == ("camera_disagrees", ("hd05",))
    assert (report.misplaced, finding.remedy) == ((), ())


def test_two_cameras_can_disagree_but_nobody_knows_which():
    finding = only(check_rig(turned(rig("pair"), 1, 2.0, (1, 0, 0)), detections("pair")))
    assert (finding.kind, finding.subject.cameras) == ("camera_disagrees", ("left", "right"))


def test_cameras_without_detections_are_named():
    found = detections("room").copy()
    found[:, 1] = np.nan
    finding = only(check_rig(rig("room"), found))
    assert (finding.kind, finding.severity) == ("no_detections", "warning")
    assert finding.subject.cameras == ("cam2",)
    nobody = check_rig(rig("room"), np.full((T, 4, 17, 3), np.nan)).findings[-1]
    assert (nobody.kind, nobody.severity) == ("no_detections", "error")


@pytest.mark.parametrize("degrees", [0.0, 2.0])
def test_two_cameras_that_see_are_checked_as_two(degrees):
    found = detections("room").copy()
    found[:, 2:] = np.nan
    report = check_rig(turned(rig("room"), 1, degrees, (1, 0, 0)), found, layout=LAYOUT)
    kinds = ["camera_disagrees"] * (degrees > 0) + ["no_detections"] * 2
    assert sorted(finding.kind for finding in report.findings) == kinds
    assert [row.name for row in report.cameras] == ["cam1", "cam2"]


@pytest.mark.parametrize("name", ["room", "dome of 3", "pair"])
def test_detections_that_are_copied_are_no_camera_that_was_moved(name):
    found = detections(name).copy()
    found[:, 1] = found[:, 0]
    finding = only(check_rig(rig(name), found))
    assert (finding.kind, finding.severity) == ("detections_same", "error")
    assert finding.subject.cameras == tuple(rig(name).names[:2])


def test_geometry_alone():
    room, K = rig("room"), np.array(rig("room")[0].K)
    assert check_rig(room).ok
    assert check_rig(room).cameras == ()
    flip = np.diag([1, -1, -1])
    flipped = [altered(camera, R=flip @ camera.R, t=flip @ camera.t) for camera in room]
    off_centre, stretched = K.copy(), K.copy()
    off_centre[0, 2], stretched[1, 1] = 30.0, 2 * K[1, 1]
    for cameras, named in (
        (replaced(room, 0, R=room[1].R, t=room[1].t), ("cam1", "cam2")),
        (sk.CameraRig(flipped), ()),
        (turned(room, 2, 180.0, (0, 1, 0)), ("cam3",)),
        (replaced(room, 3, size=(20000, 20000)), ("cam4",)),
        (replaced(room, 3, K=stretched), ("cam4",)),
        (replaced(room, 0, K=off_centre), ("cam1",)),
    ):
        found = check_rig(cameras).findings
        assert {finding.kind for finding in found} == {"calibration_unusual"}
        assert named in [finding.subject.cameras for finding in found]


def test_bad_arguments():
    good = detections("room")
    percentages = good.copy()
    percentages[3, 1, 2, 2] = 95.0
    for cameras, people, frames, argument in (
        (rig("room"), good[:, :3], None, "people"),
        (rig("room"), good, np.zeros(T, dtype=int), "frames"),
        (rig("room")[:1], good[:, :1], None, "cameras"),
        (rig("room"), percentages, None, "people[3, 1, 0, 2, 2]"),
    ):
        with pytest.raises(sk.InvalidInputError) as error:
            check_rig(cameras, people, frames=frames)
        assert error.value.argument == argument


FLIP = np.diag([1.0, -1.0, -1.0])
CONVENTIONS = {
    "camera → world instead": lambda R, t: (R.T, -R.T @ t),
    "with y up and z backward": lambda R, t: (FLIP @ R, FLIP @ t),
    "camera → world with y up": lambda R, t: ((FLIP @ R).T, -(FLIP @ R).T @ FLIP @ t),
}


@pytest.mark.parametrize(("words", "name"), diagonal(CONVENTIONS, ("room", "dome of 3", "dome of 6", "pair")))
def test_poses_in_another_convention_are_named_alone(words, name):
    cameras = rig(name)
    for view in range(len(cameras)):
        R, t = CONVENTIONS[words](np.asarray(cameras[view].R), np.asarray(cameras[view].t))
        cameras = replaced(cameras, view, R=R, t=t)
    report = check_rig(cameras, detections(name), layout=LAYOUT)
    found = [finding for finding in report.findings if finding.kind != "calibration_unusual"]
    assert [finding.kind for finding in found] == ["pose_convention"], report.findings
    assert words in found[0].numbers["convention"]


RIG = sk.CameraRig(synthetic.human36m_like(), unit="mm")
PART = slice(41, 80)


@pytest.fixture(scope="module")
def stuck():
    """Return a walk, and its detections with one camera that repeats frame 40 for 39 frames."""
    poses = synthetic.motion("walk", 100, fps=30)
    seen = synthetic.simulate_detections(poses, RIG, noise=synthetic.DetectionNoise.good(), seed=1)
    seen[PART, 1] = seen[40, 1]
    return poses, seen


def test_a_camera_that_repeats_an_image_is_left_out_there_and_said(stuck):
    truth, seen = stuck
    repeated = frozen(seen)
    assert repeated[PART, 1].all()
    assert repeated.sum() == 39
    with pytest.warns(FindingWarning, match="repeat one image while others move"):
        result = sk.refine_sequence(seen, RIG, fps=30, layout="h36m17")
    assert np.nanmean(np.linalg.norm(result.pose - truth, axis=-1)[PART]) < 25
    assert not np.isfinite(result.view_weights[PART, 1]).any()
    with pytest.warns(FindingWarning, match="repeat one image while others move"):
        (person,) = sk.track(seen[:, :, None], RIG, fps=30, layout="h36m17")
    assert (person.slots[PART, 1] == -1).all()
    (finding,) = [one for one in check_rig(RIG, seen).findings if one.kind == "camera_frozen"]
    assert (finding.subject.cameras, finding.numbers["frames"]) == ((RIG.names[1],), [39])


def test_frames_that_are_doubled_a_scene_that_stands_still_and_a_view_of_nothing_are_not(stuck):
    seen, blind = stuck[1], stuck[1].copy()
    blind[:, 0] = (np.nan, np.nan, 0.0)
    assert not frozen(blind)[:, 0].any()
    doubled = np.repeat(seen[:40], 2, axis=0)
    assert not frozen(doubled).any()
    assert not frozen(np.repeat(seen[:1], 50, axis=0)).any()
    assert not frozen(np.full((50, 4, 17, 3), np.nan)).any()
