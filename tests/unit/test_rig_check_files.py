"""Exchanged cameras and detections of other images are named, and told from each other."""

from __future__ import annotations

import numpy as np
import pytest

from rig_case import LAYOUT, detections, mirrored, only, recording, rig
from skelsplat.io import sample
from skelsplat.rig_check import check_rig
from sweeps import diagonal, swept


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


def test_three_cameras_in_a_circle_are_named():
    finding = only(check_rig(rig("room"), detections("room")[:, [2, 0, 1, 3]]))
    assert finding.kind == "cameras_exchanged"
    assert finding.numbers["folders"] == {"cam1": "cam2", "cam2": "cam3", "cam3": "cam1", "cam4": "cam4"}


def folders_of(order, names):
    """Return what the finding says of detections in this order: by camera, whose folder has its own."""
    return {names[camera]: names[place] for place, camera in enumerate(order)}


@pytest.mark.parametrize(
    ("motion", "exchange"),
    diagonal(
        ("walk", "sit", "reach"),
        (("room", (1, 0, 3, 2)), ("room", (2, 3, 0, 1)), ("dome of 3", (2, 1, 0))),
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


@pytest.mark.parametrize("motion", ["walk", "sit", swept("reach")])
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
