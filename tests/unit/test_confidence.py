"""Confidences outside [0, 1]: named where they were given; that of a missing detection does not count."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import skelsplat as sk
from skelsplat import synthetic
from skelsplat.association import choose_person
from skelsplat.evaluation import baselines
from skelsplat.findings import FindingWarning

H36M = sk.layouts.H36M17


@pytest.fixture(scope="module")
def rig():
    return synthetic.human36m_like()


@pytest.fixture(scope="module")
def detections(rig):
    pixels = np.moveaxis(sk.project(synthetic.motion("walk", 3, seed=0), rig), 0, 1)
    return np.concatenate([pixels, np.full((*pixels.shape[:-1], 1), 0.9)], axis=-1)


def refined(found, rig):
    return sk.refine(None, found, rig, layout=H36M, progress=False).pose


def apart(found, rig):
    pixels, confidence = found[..., :2], found[..., 2]
    return sk.refine(None, pixels, rig, confidence=confidence, layout=H36M, progress=False).pose


def stepped(found, rig):
    return sk.Refiner(rig, layout=H36M).step(found[1]).pose


def chosen(found, rig):
    people = np.stack([found, np.full_like(found, np.nan)], axis=2)
    return sk.triangulate(choose_person(people, rig)[0], rig)


ENTRIES = {
    "refine": (refined, "detections[1, 2, 3, 2]"),
    "confidence": (apart, "confidence[1, 2, 3]"),
    "Refiner": (stepped, "detections[2, 3, 2]"),
    "triangulate": (sk.triangulate, "detections[1, 2, 3, 2]"),
    "choose_person": (chosen, "people[1, 2, 0, 3, 2]"),
    "baselines": (baselines.dlt, "detections"),
}


@pytest.mark.parametrize("entry", ENTRIES)
def test_a_wrong_confidence_is_named_where_it_was_given(entry, detections, rig):
    call, place = ENTRIES[entry]
    found = detections.copy()
    found[1, 2, 3, 2] = 1.2
    with pytest.raises(sk.InvalidInputError) as caught:
        call(found, rig)
    assert str(caught.value).startswith(f"{place}: expected ")


@pytest.mark.parametrize("entry", [entry for entry in ENTRIES if entry not in ("baselines",)])
def test_a_confidence_slightly_above_1_counts_as_1_with_one_warning(entry, detections, rig):
    call, place = ENTRIES[entry]
    found = detections.copy()
    found[1, 2, 3, 2] = 1.0
    found[1, 1, 4] = [800.0, 500.0, np.nan]  # a detection without a confidence is missing
    expected = call(found, rig)
    found[1, 2, 3, 2] = 1.0103
    text = f"^{place.partition('[')[0]}: confidences slightly above 1, up to 1.05, count as 1[.]$"
    with pytest.warns(FindingWarning, match=text) as told:
        np.testing.assert_array_equal(call(found, rig), expected)
    assert {Path(one.filename) for one in told} == {Path(__file__)}
    assert len({str(one.message) for one in told}) == 1  # which Python shows once per line
    assert found[1, 2, 3, 2] == 1.0103


@pytest.mark.parametrize("entry", ENTRIES)
def test_the_confidence_of_a_missing_detection_does_not_count(entry, detections, rig):
    call, _ = ENTRIES[entry]
    found = detections.copy()
    found[1, 2, 3] = np.nan
    without = call(found, rig)
    for score in (-1.0, 95.0, np.inf):
        found[1, 2, 3] = [np.nan, 5.0, score]  # half a pixel is none
        np.testing.assert_array_equal(call(found, rig), without)
