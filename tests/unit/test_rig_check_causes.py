"""A camera that is out of step, turned or moved is named, with what explains nearly as much."""

from __future__ import annotations

import numpy as np
import pytest

import skelsplat as sk
from rig_case import LAYOUT, T, detections, mirrored, only, recording, rig, turned
from skelsplat.io import sample
from skelsplat.layouts import mirror_images
from skelsplat.rig_check import check_rig
from sweeps import diagonal, swept

MIRROR = mirror_images(17, sk.layouts.H36M17.left_right)


@pytest.mark.parametrize(
    ("name", "motion", "shift"), diagonal(("room", "dome of 3", "dome of 6"), ("walk", "sit"), (3, -4))
)
def test_a_frame_offset_is_named(name, motion, shift):
    whole = detections(name, motion, steps=T + 10)
    found = whole[5 : 5 + T].copy()
    found[:, 1] = whole[5 - shift : 5 - shift + T, 1]  # what the others see `shift` frames earlier
    report = check_rig(rig(name), found, layout=LAYOUT)
    finding = only(report)
    assert (finding.kind, finding.subject.cameras) == ("frame_offset", (rig(name).names[1],))
    assert finding.numbers["frames"] == shift
    assert report.cameras[1].best_offset == shift
    assert report.cameras[1].best_offset_px < report.cameras[1].left_out_px


def test_what_explains_nearly_as_much_is_said():
    """In the recording two of the four cameras could be the turned one."""
    cameras, people = recording()
    finding = only(check_rig(cameras, people, layout=sample.LAYOUT))
    assert (finding.kind, finding.subject.cameras) == ("camera_moved", ("cam_03",))
    assert " Rotating cam_01 by 1." in finding.text
    (rival,) = finding.numbers["rivals"]
    assert (rival["camera"], rival["kind"]) == ("cam_01", "rotated")
    assert "few_frames" not in finding.numbers
    few = check_rig(cameras, people[:3], layout=sample.LAYOUT).findings[0]
    assert few.numbers["few_frames"] == 3


def test_a_turn_and_an_offset_of_the_same_camera_are_told_apart_or_both_said():
    """At 50 frames per second two frames of a walk are a small turn, too."""
    whole = detections("room", steps=T + 10)
    found = whole[5 : 5 + T].copy()
    found[:, 0] = whole[3 : 3 + T, 0]
    finding = only(check_rig(rig("room"), found, layout=LAYOUT))
    assert (finding.kind, finding.subject.cameras, finding.numbers["frames"]) == (
        "frame_offset",
        ("cam1",),
        2,
    )
    assert [rival["kind"] for rival in finding.numbers["rivals"]] == ["rotated"]


def test_an_offset_between_two_cameras_is_named():
    whole = detections("pair", "sit", steps=T + 10)
    found = whole[5 : 5 + T].copy()
    found[:, 1] = whole[:T, 1]
    finding = only(check_rig(rig("pair"), found))
    assert (finding.kind, finding.subject.cameras, finding.numbers["frames"]) == (
        "frame_offset",
        ("right",),
        5,
    )


@pytest.mark.parametrize(
    ("name", "axis"),
    diagonal(("room", "dome of 3", "dome of 6"), ((1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1))),
)
def test_a_camera_turned_by_two_degrees_is_named(name, axis):
    finding = only(check_rig(turned(rig(name), 1, 2.0, axis), detections(name), layout=LAYOUT))
    assert (finding.kind, finding.subject.cameras) == ("camera_moved", (rig(name).names[1],))
    # 3 px of noise at 1100 px and more are 0.15° a detection; hundreds of them are averaged
    assert finding.numbers["degrees"] == pytest.approx(2.0, abs=0.1)


def sides_swapped(found, view, frames=slice(None)):
    """Return the detections with left and right swapped in some frames of a view."""
    changed = found.copy()
    changed[frames, view] = found[frames, view][..., MIRROR, :]
    return changed


@pytest.mark.parametrize(
    ("name", "motion", "share"),
    diagonal(("room", "dome of 3", "dome of 6", "ring of 4"), ("walk", "sit", "reach"), (1.0, 0.8, 1 / 3)),
)
def test_swapped_sides_are_named_not_a_moved_camera(name, motion, share):
    swapped = np.arange(T) % 5 < 5 * share if share > 0.5 else np.arange(T) % 3 == 1
    finding = only(check_rig(rig(name), sides_swapped(detections(name, motion), 1, swapped), layout=LAYOUT))
    assert (finding.kind, finding.subject.cameras) == ("sides_swapped", (rig(name).names[1],))
    assert finding.numbers["share_of_frames"] == pytest.approx(share, abs=0.06)
    if share > 0.5:
        assert finding.numbers["after_px"] < 6 < finding.numbers["before_px"]


@pytest.mark.parametrize("name", ["room", "dome of 3", "ring of 4"])
def test_sides_of_sound_views_and_of_two_frames_are_not_named(name):
    for noise in ("noisy", "occluded"):
        assert check_rig(rig(name), detections(name, "reach", noise), layout=LAYOUT).ok
    few = sides_swapped(detections(name)[:12], 1, [3, 7])
    assert check_rig(rig(name), few, layout=LAYOUT).ok


def test_swapped_sides_of_one_of_two_views():
    finding = only(check_rig(rig("pair"), sides_swapped(detections("pair", "reach"), 1), layout=LAYOUT))
    assert (finding.kind, finding.subject.cameras) == ("sides_swapped", ("left",))
    assert [rival["camera"] for rival in finding.numbers["rivals"]] == ["right"]


@pytest.mark.parametrize("named_by_detector", [True, swept(False)])
def test_mirrored_images_of_a_camera_are_named(named_by_detector):
    """A detector takes the left hand of a mirrored person for the right one; mirrored coordinates do not."""
    found = sides_swapped(detections("room"), 1) if named_by_detector else detections("room").copy()
    found[:, 1] = mirrored(found, "room")[:, 1]
    finding = only(check_rig(rig("room"), found, layout=LAYOUT))
    assert (finding.kind, finding.subject.cameras) == ("images_changed", ("cam2",))
    assert finding.numbers["images"] == "mirrored"


def test_two_faults_are_both_named():
    whole = detections("dome of 6", steps=T + 10)
    found = whole[5 : 5 + T].copy()
    found[:, 4] = whole[2 : 2 + T, 4]
    report = check_rig(turned(rig("dome of 6"), 1, 2.0, (1, 0, 0)), found)
    assert {finding.kind: finding.subject.cameras for finding in report.findings} == {
        "camera_moved": ("hd01",),
        "frame_offset": ("hd04",),
    }


@pytest.mark.parametrize(
    ("name", "pair", "motion"), diagonal(("room", "dome of 6"), ((0, 1), (0, 2)), ("walk", "sit"))
)
def test_exchanged_names_are_named(name, pair, motion):
    found = detections(name, motion).copy()
    found[:, list(pair)] = found[:, list(pair[::-1])]
    finding = only(check_rig(rig(name), found, layout=LAYOUT))
    names = [rig(name).names[i] for i in pair]
    assert finding.kind == "cameras_exchanged"
    assert finding.subject.cameras == tuple(names)
    assert finding.numbers["folders"][names[0]] == names[1]


def folders_of(order, names):
    """Return what the finding says of detections in this order: by camera, whose folder has its own."""
    return {names[camera]: names[place] for place, camera in enumerate(order)}


@pytest.mark.parametrize(
    ("motion", "exchange"),
    diagonal(
        ("walk", "sit", "reach"), (("room", (1, 0, 3, 2)), ("room", (2, 3, 0, 1)), ("dome of 3", (2, 1, 0)))
    ),
)
def test_exchanged_cameras_are_no_mirrored_images(motion, exchange):
    """In a room that is nearly symmetric mirrored images set them right, too, but not as well."""
    name, order = exchange
    finding = only(check_rig(rig(name), detections(name, motion)[:, list(order)], layout=LAYOUT))
    assert finding.kind == "cameras_exchanged"
    assert finding.numbers["folders"] == folders_of(order, rig(name).names)
    near = (name, motion) in {("room", "sit"), ("room", "reach")}
    assert ("rivals" in finding.numbers) == near


@pytest.mark.parametrize("motion", [swept("walk"), "sit", swept("reach")])
def test_mirrored_images_are_no_exchanged_cameras(motion):
    finding = only(check_rig(rig("room"), mirrored(detections("room", motion), "room"), layout=LAYOUT))
    assert finding.kind == "images_changed"
    assert finding.numbers["images"] == "mirrored"
    across = {"cam1": "cam3", "cam2": "cam4", "cam3": "cam1", "cam4": "cam2"}
    assert finding.numbers.get("rivals") == (None if motion == "walk" else [[{"folders": across}]])


@pytest.mark.parametrize("order", [(1, 2, 0, 3), swept((3, 2, 1, 0)), swept((3, 0, 2, 1))])
def test_exchanged_cameras_of_a_recording_are_no_images_of_another_size(order):
    """Another size or images upside down would take the half, or the third, of the disagreement away."""
    cameras, people = recording()
    exchange, turned = check_rig(cameras, people[:, list(order)], layout=sample.LAYOUT).findings
    assert exchange.kind == "cameras_exchanged"
    assert exchange.numbers["folders"] == folders_of(order, cameras.names)
    assert (turned.kind, turned.subject.cameras) == ("camera_moved", ("cam_03",))


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
        (upside, "hd02", "upside down"),
        (flipped, "hd03", "mirrored"),
        (half, "hd01", "of another size"),
    ):
        finding = only(check_rig(rig("dome of 6"), found))
        assert finding.subject.cameras == (camera,)
        assert text in finding.numbers["images"]


def test_all_detections_of_other_images_are_named():
    good, size = detections("dome of 6"), np.array(rig("dome of 6")[0].size)
    exchanged, parts, small = good.copy(), good.copy(), good.copy()
    exchanged[..., :2] = good[..., 1::-1]
    parts[..., :2] = (good[..., :2] + 0.5) / size
    small[..., :2] = (good[..., :2] + 0.5) * 2 / 3 - 0.5
    for found, text in (
        (exchanged, "given with y before x"),
        (parts, "given in parts of width and height"),
        (small, "of images 0.667 times as large"),
    ):
        finding = only(check_rig(rig("dome of 6"), found))
        assert (finding.kind, finding.subject.cameras) == ("images_changed", ())
        assert text in finding.numbers["images"]
