"""Simulated faults of a rig must be named, and a rig without one must not be accused."""

from __future__ import annotations

import re
from functools import cache

import numpy as np
import pytest

import skelsplat as sk
from skelsplat import synthetic
from skelsplat.io import read_calibration, read_detections, sample
from skelsplat.rig_check import check_rig
from skelsplat.rig_check._resection import rotation

T = 40
LAYOUT = "h36m17"


@cache
def rig(name):
    return {
        "room": lambda: synthetic.human36m_like(distortion=True),
        "dome of 3": lambda: synthetic.dome(3),
        "dome of 6": lambda: synthetic.dome(6),
        "ring of 4": lambda: synthetic.ring(4),
        "pair": synthetic.stereo,
    }[name]()


@cache
def detections(name, motion="walk", noise="good", steps=T):
    kind = {
        "good": synthetic.DetectionNoise.good,
        "noisy": synthetic.DetectionNoise.noisy,
        "occluded": lambda: synthetic.DetectionNoise.occluded(2),
    }[noise]()
    found = synthetic.simulate_detections(
        synthetic.motion(motion, steps, seed=1), rig(name), noise=kind, seed=3
    )
    found.setflags(write=False)
    return found


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """Return cameras and people of the recording in the package, every third frame."""
    paths = sample.extract(tmp_path_factory.mktemp("sample"))
    cameras = read_calibration(paths.calibration, unit=sample.UNIT)
    return cameras, read_detections(paths.detections, cameras, layout=sample.LAYOUT).people[::3]


def mirrored(found, name):
    """Return detections (T, M, N, 3) of mirrored images of a rig's cameras."""
    changed = found.copy()
    changed[..., 0] = np.array([camera.size[0] for camera in rig(name)])[:, None] - 1 - found[..., 0]
    return changed


def replaced(cameras, view, **changes):
    """Return the rig with one camera's R or t changed."""
    made = list(cameras)
    c = made[view]
    given = {"R": c.R, "t": c.t, "size": c.size, "K": c.K, **changes}
    made[view] = sk.Camera(
        given["K"], given["R"], given["t"], distortion=c.distortion, size=given["size"], name=c.name
    )
    return sk.CameraRig(made, unit=cameras.unit)


def turned(cameras, view, degrees, axis):
    turn = rotation(np.radians(degrees) * np.array(axis) / np.linalg.norm(axis))
    camera = cameras[view]
    return replaced(cameras, view, R=turn @ camera.R, t=turn @ camera.t)


def only(report):
    """Return the one finding of a report."""
    assert len(report.findings) == 1, [finding.text for finding in report.findings]
    return report.findings[0]


@pytest.mark.parametrize("noise", ["good", "noisy", "occluded"])
@pytest.mark.parametrize("motion", ["walk", "sit", "reach"])
@pytest.mark.parametrize("name", ["room", "dome of 3", "dome of 6", "pair"])
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


@pytest.mark.parametrize("motion", ["walk", "sit"])
@pytest.mark.parametrize("pair", [(0, 1), (0, 2), (1, 3)])
@pytest.mark.parametrize("name", ["room", "dome of 6"])
def test_exchanged_names_are_named(name, pair, motion):
    found = detections(name, motion).copy()
    found[:, list(pair)] = found[:, list(pair[::-1])]
    finding = only(check_rig(rig(name), found, layout=LAYOUT))
    names = [rig(name).names[i] for i in pair]
    assert finding.kind == "exchanged"
    assert finding.cameras == tuple(names)
    assert finding.numbers["folders"][names[0]] == names[1]
    assert f"The detections of {names[0]} and {names[1]} are exchanged" in finding.text


def test_three_cameras_in_a_circle_are_named():
    finding = only(check_rig(rig("room"), detections("room")[:, [2, 0, 1, 3]]))
    assert finding.kind == "exchanged"
    assert "those of cam3 belong to cam2" in finding.text
    assert finding.numbers["folders"] == {"cam1": "cam2", "cam2": "cam3", "cam3": "cam1", "cam4": "cam4"}


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("pair", [(0, 1), (1, 2), (0, 3)])
def test_in_a_symmetric_ring_the_fewest_exchanges_are_named(pair, seed):
    """A cycle of three leaves the same but for noise: it is the exchange, seen with the world turned."""
    cameras = synthetic.ring(4)
    found = synthetic.simulate_detections(
        synthetic.motion("walk", T, seed=1), cameras, noise=synthetic.DetectionNoise.good(), seed=seed
    )
    i, j = pair
    found[:, [i, j]] = found[:, [j, i]]
    finding = check_rig(cameras, found, layout=LAYOUT).findings[0]
    assert (finding.kind, finding.cameras) == ("exchanged", (cameras.names[i], cameras.names[j]))


def folders_of(order, names):
    """Return what the finding says of detections in this order: by camera, whose folder has its own."""
    return {names[camera]: names[place] for place, camera in enumerate(order)}


@pytest.mark.parametrize("motion", ["walk", "sit", "reach"])
@pytest.mark.parametrize(
    ("name", "order"),
    [("room", (1, 0, 3, 2)), ("room", (2, 3, 0, 1)), ("dome of 3", (2, 1, 0))],
)
def test_exchanged_cameras_are_no_mirrored_images(name, order, motion):
    """In a room that is nearly symmetric mirrored images set them right, too, but not as well."""
    finding = only(check_rig(rig(name), detections(name, motion)[:, list(order)], layout=LAYOUT))
    assert finding.kind == "exchanged"
    assert finding.numbers["folders"] == folders_of(order, rig(name).names)
    near = (name, motion) in {("room", "sit"), ("room", "reach")}
    rival = "That the detections of all cameras are mirrored would fit almost as well."
    assert finding.text.endswith(rival) == near


@pytest.mark.parametrize("motion", ["walk", "sit", "reach"])
def test_mirrored_images_are_no_exchanged_cameras(motion):
    finding = only(check_rig(rig("room"), mirrored(detections("room", motion), "room"), layout=LAYOUT))
    assert finding.kind == "images"
    assert "The detections of all cameras are mirrored" in finding.text
    rival = (
        "That the detections of 4 cameras are exchanged (or their calibrations): those of cam3 belong to "
        "cam1, those of cam4 belong to cam2, those of cam1 belong to cam3, those of cam2 belong to cam4 "
        "would fit almost as well."
    )
    assert finding.text.endswith(rival) == (motion != "walk")


def test_where_nothing_tells_them_apart_both_are_mentioned():
    found = detections("ring of 4", "sit")
    for people in (mirrored(found, "ring of 4"), found[:, [0, 3, 2, 1]]):
        finding = only(check_rig(rig("ring of 4"), people, layout=LAYOUT))
        assert finding.kind == "images"
        # two that face each other, whichever; an order of all four leaves the same and is no simpler
        assert re.search("That the detections of (cam0 and cam2|cam1 and cam3) are exchanged", finding.text)


@pytest.mark.parametrize("order", [(3, 2, 1, 0), (1, 2, 0, 3), (3, 0, 2, 1)])
def test_exchanged_cameras_of_a_recording_are_no_images_of_another_size(recording, order):
    """Another size or images upside down would take the half, or the third, of the disagreement away."""
    cameras, people = recording
    exchange, turned = check_rig(cameras, people[:, list(order)], layout=sample.LAYOUT).findings
    assert exchange.kind == "exchanged"
    assert exchange.numbers["folders"] == folders_of(order, cameras.names)
    assert (turned.kind, turned.cameras) == ("turned", ("cam_03",))


@pytest.mark.parametrize(("factor", "words"), [(3 / 4, "0.75"), (4 / 3, "1.33")])
def test_a_recording_of_another_size_has_no_exchanged_cameras(recording, factor, words):
    cameras, people = recording
    resized = people.copy()
    resized[..., :2] = (people[..., :2] + 0.5) * factor - 0.5
    images, turned = check_rig(cameras, resized, layout=sample.LAYOUT).findings
    assert images.text.startswith(f"The detections of all cameras are of images {words} times as large: ")
    assert "almost as well" not in images.text
    assert (turned.kind, turned.cameras) == ("turned", ("cam_03",))


@pytest.mark.parametrize("shift", [3, -4])
@pytest.mark.parametrize("motion", ["walk", "sit"])
@pytest.mark.parametrize("name", ["room", "dome of 3", "dome of 6"])
def test_a_frame_offset_is_named(name, motion, shift):
    whole = detections(name, motion, steps=T + 10)
    found = whole[5 : 5 + T].copy()
    found[:, 1] = whole[5 - shift : 5 - shift + T, 1]  # what the others see `shift` frames earlier
    report = check_rig(rig(name), found, layout=LAYOUT)
    finding = only(report)
    assert (finding.kind, finding.cameras) == ("offset", (rig(name).names[1],))
    assert finding.numbers["frames"] == shift
    assert f"frame f{shift:+d} belongs to frame f of the others" in finding.text
    assert report.cameras[1].best_offset == shift
    assert report.cameras[1].best_offset_px < report.cameras[1].left_out_px


def test_what_explains_nearly_as_much_is_said(recording):
    """In the recording two of the four cameras could be the turned one."""
    cameras, people = recording
    finding = only(check_rig(cameras, people, layout=sample.LAYOUT))
    assert (finding.kind, finding.cameras) == ("turned", ("cam_03",))
    assert " Nearly as well the cameras agree with cam_01 turned by 1." in finding.text
    (rival,) = finding.numbers["rivals"]
    assert (rival["camera"], rival["kind"]) == ("cam_01", "turned")
    assert "Only" not in finding.text
    few = check_rig(cameras, people[:3], layout=sample.LAYOUT).findings[0]
    assert few.text.endswith(" Only 3 frames say so: give more.")


@pytest.mark.parametrize("name", ["room", "dome of 6"])
def test_what_explains_much_less_is_not(name):
    found = check_rig(turned(rig(name), 1, 4.0, (0, 1, 0)), detections(name), layout=LAYOUT)
    assert "Nearly as well" not in only(found).text
    assert "rivals" not in only(found).numbers


def test_a_turn_and_an_offset_of_the_same_camera_are_told_apart_or_both_said():
    """At 50 frames per second two frames of a walk are a small turn, too."""
    whole = detections("room", steps=T + 10)
    found = whole[5 : 5 + T].copy()
    found[:, 0] = whole[3 : 3 + T, 0]
    finding = only(check_rig(rig("room"), found, layout=LAYOUT))
    assert (finding.kind, finding.cameras, finding.numbers["frames"]) == ("offset", ("cam1",), 2)
    assert " Nearly as well the cameras agree with cam1 turned by 0." in finding.text


@pytest.mark.parametrize(("shift", "words"), [(-5, " (4 to 5 fit nearly as well), "), (5, " too high, its")])
def test_frames_that_fit_nearly_as_well_are_a_range(shift, words):
    found, whole = detections("room").copy(), detections("room")
    found[:, 1] = np.nan
    here, there = slice(max(shift, 0), T + min(shift, 0)), slice(max(-shift, 0), T + min(-shift, 0))
    found[here, 1] = whole[there, 1]
    finding = only(check_rig(rig("room"), found, layout=LAYOUT))
    assert (finding.kind, finding.cameras, finding.numbers["frames"]) == ("offset", ("cam2",), shift)
    assert finding.numbers["frames_nearly_as_good"] == ([-5, -4] if shift < 0 else [5, 5])
    assert words in finding.text


def test_a_frame_offset_counts_frame_numbers_not_places():
    whole = detections("room", steps=T + 10)
    keep = np.delete(np.arange(T), [7, 8, 20])
    found = whole[5 : 5 + T].copy()
    found[:, 2] = whole[2 : 2 + T, 2]
    finding = only(check_rig(rig("room"), found[keep], frames=100 + keep))
    assert (finding.kind, finding.numbers["frames"]) == ("offset", 3)


def test_an_offset_between_two_cameras_is_named():
    whole = detections("pair", "sit", steps=T + 10)
    found = whole[5 : 5 + T].copy()
    found[:, 1] = whole[:T, 1]
    finding = only(check_rig(rig("pair"), found))
    assert (finding.kind, finding.cameras, finding.numbers["frames"]) == ("offset", ("right",), 5)


@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)])
@pytest.mark.parametrize("name", ["room", "dome of 3", "dome of 6"])
def test_a_camera_turned_by_two_degrees_is_named(name, axis):
    finding = only(check_rig(turned(rig(name), 1, 2.0, axis), detections(name), layout=LAYOUT))
    assert (finding.kind, finding.cameras) == ("turned", (rig(name).names[1],))
    # 3 px of noise at 1100 px and more are 0.15° a detection; hundreds of them are averaged
    assert finding.numbers["degrees"] == pytest.approx(2.0, abs=0.1)
    assert ("A picture shifted by" in finding.text) == (axis in [(1, 0, 0), (0, 1, 0)])


def test_a_moved_camera_is_named():
    camera = rig("room")[2]
    moved = replaced(rig("room"), 2, t=np.add(camera.t, [150.0, 0.0, 0.0]))
    finding = only(check_rig(moved, detections("room")))
    assert finding.kind in ("moved", "turned")  # a turn does as well for a person in the middle of the room
    assert finding.cameras == ("cam3",)
    assert finding.numbers["before_px"] > 5 * finding.numbers["after_px"]


def test_two_faults_are_both_named():
    whole = detections("dome of 6", steps=T + 10)
    found = whole[5 : 5 + T].copy()
    found[:, 4] = whole[2 : 2 + T, 4]
    report = check_rig(turned(rig("dome of 6"), 1, 2.0, (1, 0, 0)), found)
    assert {finding.kind: finding.cameras for finding in report.findings} == {
        "turned": ("hd01",),
        "offset": ("hd04",),
    }
    first, second = report.findings
    assert "are put right" not in first.text
    assert "is put right" not in first.text
    assert f"px off what the others say once {first.cameras[0]} is put right, with that" in second.text


@pytest.mark.parametrize("unit", ["m", "cm"])
@pytest.mark.parametrize("name", ["room", "pair"])
def test_a_wrong_unit_is_named(name, unit):
    report = check_rig(sk.CameraRig(list(rig(name)), unit=unit), detections(name))
    finding = only(report)
    assert finding.kind == "unit"
    assert finding.numbers["likely"] == "mm"
    assert f"In {unit} the person measures about " in finding.text
    assert finding.text.endswith('the unit of the calibration is most likely "mm".')


def scaled(by, unit):
    made = [
        sk.Camera(c.K, c.R, np.asarray(c.t) * by, distortion=c.distortion, size=c.size, name=c.name)
        for c in rig("room")
    ]
    return sk.CameraRig(made, unit=unit)


def test_a_scale_that_is_no_unit_is_named():
    finding = only(check_rig(scaled(30.0, "m"), detections("room")))
    assert finding.kind == "unit"
    assert "was the calibration scaled?" in finding.text


def test_an_animal_need_not_have_a_person_s_size():
    human, mouse = sk.layouts.H36M17, scaled(0.05, "mm")
    own = sk.Layout("mouse", human.joints, limbs=human.limbs, left_right=human.left_right)
    assert check_rig(mouse, detections("room"), layout=own).ok
    for layout in (None, LAYOUT, human):
        assert only(check_rig(mouse, detections("room"), layout=layout)).kind == "unit"
    finding = only(check_rig(scaled(0.05, "m"), detections("room"), layout=own))
    assert finding.kind == "unit"
    assert finding.text.startswith("In m the body measures about ")
    assert finding.text.endswith(" m: is that the calibration's unit?")


def test_detections_of_other_images_are_named():
    size = np.array(rig("dome of 6")[0].size)
    good = detections("dome of 6")
    upside = good.copy()
    upside[:, 2, :, :2] = size - 1 - upside[:, 2, :, :2]
    flipped = good.copy()
    flipped[:, 3, :, 0] = size[0] - 1 - flipped[:, 3, :, 0]
    half = good.copy()
    half[:, 1, :, :2] = (half[:, 1, :, :2] + 0.5) / 2 - 0.5
    for found, camera, text in (
        (upside, "hd02", "its images are upside down"),
        (flipped, "hd03", "its images are mirrored"),
        (half, "hd01", "of images of another size; multiplied by 2"),
    ):
        finding = only(check_rig(rig("dome of 6"), found))
        assert finding.cameras == (camera,)
        assert text in finding.text


def test_all_detections_of_other_images_are_named():
    good, size = detections("dome of 6"), np.array(rig("dome of 6")[0].size)
    exchanged, parts, small = good.copy(), good.copy(), good.copy()
    exchanged[..., :2] = good[..., 1::-1]
    parts[..., :2] = (good[..., :2] + 0.5) / size
    small[..., :2] = (good[..., :2] + 0.5) * 2 / 3 - 0.5
    for found, text in (
        (exchanged, "given with y before x"),
        (parts, "given as parts of the image's width and height"),
        (small, "of images 0.667 times as large"),
    ):
        finding = only(check_rig(rig("dome of 6"), found))
        assert (finding.kind, finding.cameras) == ("images", ())
        assert text in finding.text


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
    assert (finding.kind, finding.cameras) == ("exchanged", ("cam1", "cam4"))


@pytest.mark.parametrize(
    ("name", "degrees", "mm"),
    [
        ("room", 5, 100),
        ("room", 10, 500),
        ("dome of 3", 10, 500),
        ("dome of 6", 5, 100),
        ("dome of 6", 10, 500),
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
    assert finding.kind == "recording"
    assert finding.text.startswith("Calibration and detections probably do not belong together")
    assert 2 * len(finding.cameras) >= len(cameras)


def test_a_camera_that_sees_something_else_disagrees():
    found = detections("dome of 6").copy()
    found[:, 5, :, :2] = np.random.default_rng(0).uniform(0, 1000, found[:, 5, :, :2].shape)
    finding = only(check_rig(rig("dome of 6"), found))
    assert (finding.kind, finding.cameras) == ("disagrees", ("hd05",))
    assert "nothing that was tried explains it" in finding.text


def test_two_cameras_can_disagree_but_nobody_knows_which():
    finding = only(check_rig(turned(rig("pair"), 1, 2.0, (1, 0, 0)), detections("pair")))
    assert (finding.kind, finding.cameras) == ("disagrees", ("left", "right"))
    assert "nothing says which is wrong" in finding.text


def test_cameras_without_detections_are_named():
    found = detections("room").copy()
    found[:, 1] = np.nan
    finding = only(check_rig(rig("room"), found))
    assert (finding.kind, finding.cameras, finding.text) == (
        "detections",
        ("cam2",),
        "cam2 has no detections.",
    )
    report = check_rig(rig("room"), np.full((T, 4, 17, 3), np.nan))
    assert report.findings[-1].text == "There is no detection to judge the cameras by."


def test_geometry_alone():
    room = rig("room")
    assert check_rig(room).ok
    assert check_rig(room).cameras == ()
    flipped = [
        sk.Camera(c.K, np.diag([1, -1, -1]) @ c.R, np.diag([1, -1, -1]) @ c.t, size=c.size) for c in room
    ]
    for cameras, text in (
        (replaced(room, 0, R=room[1].R, t=room[1].t), "cam1 and cam2 stand in the same place"),
        (sk.CameraRig(flipped), "All cameras look away from the point"),
        (turned(room, 2, 180.0, (0, 1, 0)), "cam3 looks away from where the other cameras look."),
        (
            replaced(room, 3, size=(20000, 20000)),
            "cam4: a focal length of 1145 px on images of 20000 by 20000 px",
        ),
        (replaced(room, 3, K=np.diag([1, 1, 1]) @ [[1145, 0, 500], [0, 2290, 500], [0, 0, 1]]), "not square"),
    ):
        texts = [finding.text for finding in check_rig(cameras).findings]
        assert all(finding.kind == "geometry" for finding in check_rig(cameras).findings)
        assert any(text in found for found in texts), texts


def test_a_principal_point_far_from_the_middle():
    K = np.array(rig("room")[0].K)
    K[0, 2] = 30.0
    finding = only(check_rig(replaced(rig("room"), 0, K=K)))
    assert (
        "cam1: the principal point (30, 500) lies far from the middle of images of 1000 by 1002"
        in finding.text
    )


def test_bad_arguments():
    good = detections("room")
    with pytest.raises(sk.InvalidInputError, match=r"people: expected shape \(T, 4, P, N, 3\) .* got"):
        check_rig(rig("room"), good[:, :3])
    with pytest.raises(sk.InvalidInputError, match="frames: expected 40 ascending numbers"):
        check_rig(rig("room"), good, frames=np.zeros(T, dtype=int))
    with pytest.raises(sk.InvalidInputError, match="cameras: expected at least two beside detections, got 1"):
        check_rig(rig("room")[:1], good[:, :1])
    percentages = good.copy()
    percentages[3, 1, 2, 2] = 95.0
    with pytest.raises(sk.InvalidInputError, match=r"people\[3, 1, 0, 2, 2\]: expected a value in \[0, 1\]"):
        check_rig(rig("room"), percentages)


FLIP = np.diag([1.0, -1.0, -1.0])
CONVENTIONS = {
    "camera → world instead": lambda R, t: (R.T, -R.T @ t),
    "with y up and z backward": lambda R, t: (FLIP @ R, FLIP @ t),
    "camera → world with y up": lambda R, t: ((FLIP @ R).T, -(FLIP @ R).T @ FLIP @ t),
}


@pytest.mark.parametrize("name", ["room", "dome of 3", "dome of 6", "pair"])
@pytest.mark.parametrize("words", CONVENTIONS)
def test_poses_in_another_convention_are_named_alone(name, words):
    cameras = rig(name)
    for view in range(len(cameras)):
        R, t = CONVENTIONS[words](np.asarray(cameras[view].R), np.asarray(cameras[view].t))
        cameras = replaced(cameras, view, R=R, t=t)
    report = check_rig(cameras, detections(name), layout=LAYOUT)
    found = [finding for finding in report.findings if finding.kind not in ("geometry",)]
    assert [finding.kind for finding in found] == ["convention"], report.findings
    assert words in found[0].text
