"""A rig without a fault must not be accused; unit, convention, geometry and whole recordings."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import skelsplat as sk
from rig_case import LAYOUT, T, detections, only, replaced, rig, turned
from skelsplat import synthetic
from skelsplat.cameras import matrix_from_vector as rotation
from skelsplat.rig_check import check_rig
from skelsplat.rig_check._scene import Scene, in_mm, scene_of
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


@pytest.mark.parametrize("steps", [1, 3, 8])
def test_a_short_recording_is_no_reason_to_accuse(steps):
    assert check_rig(rig("room"), detections("room", steps=steps)).ok


def test_a_person_who_stands_still_is_no_reason_to_accuse():
    still = np.repeat(synthetic.motion("walk", 1, seed=1), T, axis=0)
    noise = synthetic.DetectionNoise.good()
    found = synthetic.simulate_detections(still, rig("room"), noise=noise, seed=3)
    assert check_rig(rig("room"), found).ok


def test_detections_without_noise_are_no_reason_to_accuse():
    exact = sk.project(synthetic.motion("walk", T, seed=1), rig("room")).swapaxes(0, 1)
    assert check_rig(rig("room"), exact).ok


@pytest.mark.parametrize("unit", ["m", "cm"])
@pytest.mark.parametrize("name", ["room", "pair"])
def test_a_wrong_unit_is_named(name, unit):
    report = check_rig(sk.CameraRig(list(rig(name)), unit=unit), detections(name))
    finding = only(report)
    assert finding.kind == "unit_wrong"
    assert finding.numbers["likely"] == "mm"
    assert f"With unit {unit}, the person measures about " in finding.text
    assert finding.text.endswith('The unit of the calibration is most likely "mm".')


def scaled(by, unit):
    made = [
        sk.Camera(c.K, c.R, np.asarray(c.t) * by, distortion=c.distortion, size=c.size, name=c.name)
        for c in rig("room")
    ]
    return sk.CameraRig(made, unit=unit)


def test_a_scale_that_is_no_unit_is_named():
    finding = only(check_rig(scaled(30.0, "m"), detections("room")))
    assert finding.kind == "unit_unknown"
    assert "e+" not in finding.text
    assert finding.text.endswith(" m, which none of mm, cm and m explains. Was the calibration scaled?")


def test_an_animal_need_not_have_a_person_s_size():
    human, mouse = sk.layouts.H36M17, scaled(0.05, "mm")
    own = sk.Layout("mouse", human.joints, limbs=human.limbs, left_right=human.left_right)
    assert check_rig(mouse, detections("room"), layout=own).ok
    for layout in (LAYOUT, human):
        assert only(check_rig(mouse, detections("room"), layout=layout)).kind == "unit_wrong"
    assert check_rig(scaled(1e-6, "mm"), detections("room"), layout=own).ok
    finding = only(check_rig(scaled(0.05, "m"), detections("room"), layout=own))
    assert finding.kind == "body_size"
    assert finding.text.startswith("With unit m, the body measures about ")
    assert "e+" not in finding.text
    assert finding.text.endswith(" m. Is that the unit of the calibration?")


def table_top(across, size, focal):
    """Return four cameras on a circle ``across`` mm wide, and what they see of a body ``size`` mm tall."""
    lens = np.array([[focal, 0, 640], [0, focal, 360], [0, 0, 1.0]])
    places = [across / 2 * np.array([np.cos(a), np.sin(a), 0.5]) for a in np.arange(4) * np.pi / 2]
    poses = [synthetic.look_at(place, np.zeros(3)) for place in places]
    small = sk.CameraRig([sk.Camera(lens, R, t, size=(1280, 720)) for R, t in poses], unit="mm")
    body = synthetic.motion("reach", T, seed=1)
    pixels = sk.project((body - body.mean(axis=(0, 1))) * size / 1700.0, small).swapaxes(0, 1)
    return small, pixels + np.random.default_rng(5).normal(0.0, 0.5, pixels.shape)


# on a table, and under a microscope
SMALL = [(1300.0, 100.0, 1200.0), (300.0, 30.0, 1200.0), (300.0, 2.5, 3e4), (20.0, 0.06, 1e5)]


@pytest.mark.parametrize("sizes", SMALL)
@pytest.mark.parametrize("layout", [None, sk.Layout("thing", sk.layouts.get(LAYOUT).joints)])
def test_what_small_rigs_see_need_not_be_a_person(sizes, layout):
    small, found = table_top(*sizes)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert check_rig(small, found, layout=layout).ok
        sk.refine(None, found[0], small, layout=layout)


def test_cameras_too_close_together_show_a_wrong_unit_without_a_layout():
    """Metres of a room that are taken for millimetres put ordinary cameras 5 mm apart."""
    small, found = table_top(5.0, 1.7, 900.0)
    finding = only(check_rig(small, found))
    assert finding.kind == "unit_wrong"
    assert finding.numbers["likely"] == "m"
    with pytest.warns(UserWarning, match="shorter than 10 cm: is the unit really 'mm'"):
        sk.refine(None, found[0], small)


@pytest.mark.parametrize("sizes", SMALL)
def test_a_small_person_of_a_human_layout_has_a_wrong_unit(sizes):
    small, found = table_top(*sizes)
    finding = only(check_rig(small, found, layout=LAYOUT))
    assert finding.kind in ("unit_wrong", "unit_unknown")


def test_the_main_person_is_judged_not_a_bystander():
    people = np.full((T, 4, 2, 17, 3), np.nan)
    people[:, :, 0] = detections("room")
    other = np.add(synthetic.motion("wave", T, seed=4), [900.0, -700.0, 0.0])
    seen = synthetic.simulate_detections(other, rig("room"), noise=synthetic.DetectionNoise.good(), seed=5)
    people[:, :2, 1] = seen[:, :2]
    people[::2, 0] = people[::2, 0, ::-1]  # the detector's order is no identity
    assert check_rig(rig("room"), people, layout=LAYOUT).ok
    swapped = people.copy()
    swapped[:, [0, 3]] = people[:, [3, 0]]
    finding = only(check_rig(rig("room"), swapped, layout=LAYOUT))
    assert (finding.kind, finding.subject.cameras) == ("cameras_exchanged", ("cam1", "cam4"))


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
    assert finding.text.startswith("Calibration and detections probably do not belong together")
    assert 2 * len(finding.subject.cameras) >= len(cameras)


def test_a_camera_that_sees_something_else_disagrees():
    found = detections("dome of 6").copy()
    found[:, 5, :, :2] = np.random.default_rng(0).uniform(0, 1000, found[:, 5, :, :2].shape)
    report = check_rig(rig("dome of 6"), found)
    finding = only(report)
    assert (finding.kind, finding.subject.cameras) == ("camera_unexplained", ("hd05",))
    assert "no tested cause explains it" in finding.text
    assert "so adjusting cameras is unlikely to help. Check that its file belongs to" in finding.text
    assert (report.misplaced, finding.remedy) == ((), ())


def test_a_camera_that_adjusting_does_not_help_is_not_among_those_it_may_correct():
    cameras, found = turned(rig("dome of 6"), 2, 2.0, (0, 1, 0)), detections("dome of 6").copy()
    found[:, 5, :, :2] = np.random.default_rng(0).uniform(0, 1000, found[:, 5, :, :2].shape)
    report = check_rig(cameras, found, layout=LAYOUT)
    assert {finding.kind: finding.subject.cameras for finding in report.findings} == {
        "camera_rotated": ("hd02",),
        "camera_unexplained": ("hd05",),
    }
    assert report.misplaced == ("hd02",)
    assert {finding.kind for finding in report.findings if finding.remedy} == {"camera_rotated"}


def test_two_cameras_can_disagree_but_nobody_knows_which():
    finding = only(check_rig(turned(rig("pair"), 1, 2.0, (1, 0, 0)), detections("pair")))
    assert (finding.kind, finding.subject.cameras) == ("cameras_apart", ("left", "right"))
    assert "it is impossible to tell which is wrong" in finding.text


def test_cameras_without_detections_are_named():
    found = detections("room").copy()
    found[:, 1] = np.nan
    finding = only(check_rig(rig("room"), found))
    assert (finding.kind, finding.subject.cameras, finding.text) == (
        "camera_blind",
        ("cam2",),
        "cam2 has no detections.",
    )
    report = check_rig(rig("room"), np.full((T, 4, 17, 3), np.nan))
    assert report.findings[-1].text == "There are no detections to check the cameras with."


@pytest.mark.parametrize("name", ["room", "dome of 3", "pair"])
def test_detections_that_are_copied_are_no_camera_that_was_moved(name):
    found = detections(name).copy()
    found[:, 1] = found[:, 0]
    finding = only(check_rig(rig(name), found))
    assert (finding.kind, finding.severity) == ("detections_same", "error")
    assert finding.subject.cameras == tuple(rig(name).names[:2])
    assert "have the same detections to the last digit" in finding.text


GEOMETRY = {
    *("field_of_view", "principal_point", "pixels_not_square"),
    *("same_place", "looks_away", "all_look_away"),
}


def test_geometry_alone():
    room = rig("room")
    assert check_rig(room).ok
    assert check_rig(room).cameras == ()
    flipped = [
        sk.Camera(c.K, np.diag([1, -1, -1]) @ c.R, np.diag([1, -1, -1]) @ c.t, size=c.size) for c in room
    ]
    for cameras, kind, text in (
        (
            replaced(room, 0, R=room[1].R, t=room[1].t),
            "same_place",
            "cam1 and cam2 are in the same place",
        ),
        (sk.CameraRig(flipped), "all_look_away", "All cameras look away from the point"),
        (
            turned(room, 2, 180.0, (0, 1, 0)),
            "looks_away",
            "cam3 looks away from where the other cameras look.",
        ),
        (
            replaced(room, 3, size=(20000, 20000)),
            "field_of_view",
            "cam4: a focal length of 1145 px on images of 20000 by 20000 px",
        ),
        (
            replaced(room, 3, K=np.diag([1, 1, 1]) @ [[1145, 0, 500], [0, 2290, 500], [0, 0, 1]]),
            "pixels_not_square",
            "not square",
        ),
    ):
        texts = {finding.kind: finding.text for finding in check_rig(cameras).findings}
        assert set(texts) <= GEOMETRY
        assert text in texts[kind], texts


def test_a_principal_point_far_from_the_middle():
    K = np.array(rig("room")[0].K)
    K[0, 2] = 30.0
    finding = only(check_rig(replaced(rig("room"), 0, K=K)))
    assert (
        "cam1: the principal point (30, 500) is far from the middle of images of 1000 by 1002" in finding.text
    )


def test_bad_arguments():
    good = detections("room")
    with pytest.raises(sk.InvalidInputError, match=r"people: expected shape \(T, 4, P, N, 3\) .* got"):
        check_rig(rig("room"), good[:, :3])
    with pytest.raises(sk.InvalidInputError, match="frames: expected 24 ascending numbers"):
        check_rig(rig("room"), good, frames=np.zeros(T, dtype=int))
    with pytest.raises(sk.InvalidInputError, match="cameras: expected at least two with detections, got 1"):
        check_rig(rig("room")[:1], good[:, :1])
    percentages = good.copy()
    percentages[3, 1, 2, 2] = 95.0
    with pytest.raises(sk.InvalidInputError, match=r"people\[3, 1, 0, 2, 2\]: expected a value in \[0, 1\]"):
        check_rig(rig("room"), percentages)


def test_what_a_change_leaves_is_not_computed_again():
    scene = scene_of(in_mm(rig("room")), detections("room")[..., :2], np.arange(T))
    points = scene.points_without(1)
    for changed in (
        scene.with_camera(1, turned(rig("room"), 1, 2.0, (1, 0, 0))[1]),
        scene.with_detections(1, scene.detections[:, 0]),
        scene.with_shift(1, 2),
    ):
        assert changed.points_without(1) is points
        anew = Scene(changed.cameras, changed.detections, changed.frames, changed.shifts)
        for view in range(scene.views):
            np.testing.assert_array_equal(changed.residuals_of(view), anew.residuals_of(view))


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
    found = [finding for finding in report.findings if finding.kind not in GEOMETRY]
    assert [finding.kind for finding in found] == ["pose_convention"], report.findings
    assert words in found[0].text


def test_a_rig_under_a_microscope_is_sound():
    """Cameras 20 mm apart with focal lengths of 10⁵ px: a field of view of 0.6°."""
    lens = np.diag([100.0, 100.0, 1.0]) @ [[1145, 0, 5], [0, 1145, 5], [0, 0, 1]]
    room = rig("room")
    cameras = [sk.Camera(lens, c.R, c.t / 400, size=c.size, name=c.name) for c in room]
    assert check_rig(sk.CameraRig(cameras, unit="mm")).findings == ()
    odd = [*cameras[:3], sk.Camera(lens, cameras[3].R, cameras[3].t, size=(80, 80), name="cam4")]
    (finding,) = [f for f in check_rig(sk.CameraRig(odd)).findings if f.kind == "field_of_view"]
    assert finding.subject.cameras == ("cam4",)
