"""Simulated data sets: numbers as in the protocols, same seed same data, occluders that hide."""

from __future__ import annotations

import numpy as np
import pytest

import skelsplat as sk
from skelsplat import synthetic
from skelsplat.synthetic.sets import MONOCULAR_SIGMA_MM

OCCLUDED = ["human36m-like-occ-2", "human36m-like-occ-3", "human36m-like-occ-3-hard"]


@pytest.fixture(scope="module")
def plain():
    return synthetic.simulate_set("human36m-like")


def errors(data, solve):
    """All joint errors, mm."""
    found = [np.linalg.norm(solve(r, data.rigs[r.rig_name]) - r.truth, axis=-1) for r in data.recordings]
    return np.concatenate(found)


def test_the_numbers_of_poses_are_those_of_the_protocol(plain):
    counts = {r.key: len(r.frames) for r in plain.recordings}
    of = {who: sum(n for key, n in counts.items() if key.startswith(f"{who}/")) for who in ("S9", "S11")}
    assert of == {"S9": 1253, "S11": 928}
    excluded = [counts[f"S9/{name}"] for name in ("SittingDown 1", "Waiting 1", "Greeting")]
    assert excluded == [25, 26, 23]
    assert sum(counts.values()) - sum(excluded) == 2107
    assert len({r.action for r in plain.recordings}) == 15
    assert all((r.frames == 64 * np.arange(len(r.frames))).all() for r in plain.recordings)


def test_the_same_seed_gives_the_same_data_and_another_one_other():
    one, two, other = (synthetic.simulate_set("dome", poses=40, seed=seed) for seed in (3, 3, 4))
    for a, b, c in zip(one.recordings, two.recordings, other.recordings, strict=True):
        for name in ("truth", "monocular", "boxes"):
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
        np.testing.assert_array_equal(a.detections["noisy"], b.detections["noisy"])
        assert not np.array_equal(a.truth, c.truth)


@pytest.mark.parametrize(
    ("name", "options", "argument"),
    [
        ("h36m", {}, "name"),
        ("human36m-like", {"poses": 59}, "poses"),
        ("dome", {"seed": -1}, "seed"),
    ],
)
def test_mistakes_are_named(name, options, argument):
    with pytest.raises(sk.InvalidInputError) as caught:
        synthetic.simulate_set(name, **options)
    assert caught.value.argument == argument


@pytest.mark.parametrize("name", OCCLUDED)
def test_occluded_sets_have_the_same_poses(plain, name):
    hidden = synthetic.simulate_set(name)
    for a, b in zip(plain.recordings, hidden.recordings, strict=True):
        np.testing.assert_array_equal(a.truth, b.truth)
        np.testing.assert_array_equal(a.monocular, b.monocular)
        assert a.visible is None
    most = 2 if name.endswith("occ-2") else 3
    views = [(~r.visible).any(axis=2).sum(axis=1).max() for r in hidden.recordings]
    assert max(views) == most


def test_both_detectors_see_the_same_occluders():
    data = synthetic.simulate_set("human36m-like-occ-3-hard", poses=200)
    rig = data.rigs["room"]
    hidden, far = [], {"good": [], "noisy": []}
    for r in data.recordings:
        pixels = np.moveaxis(np.asarray(sk.project(r.truth, rig)), 0, 1)
        hidden.append(~r.visible)
        for name, detections in r.detections.items():
            far[name].append(np.linalg.norm(detections[..., :2] - pixels, axis=-1) > 15.0)
    hidden = np.concatenate(hidden)
    for name in far:
        wrong = np.concatenate(far[name])
        assert wrong[hidden].mean() > 0.8, "what is hidden is detected at a wrong place"
        assert wrong[~hidden].mean() < 0.1


def test_fusion_of_the_monocular_poses_errs_forty_millimetres(plain):
    error = errors(plain, lambda r, rig: sk.fuse_monocular(r.monocular, r.detections["good"], rig))
    assert 37.0 < error.mean() < 43.0, f"with sigma {MONOCULAR_SIGMA_MM} mm"


def test_the_dome_has_panoptics_cameras_and_joints():
    data = synthetic.simulate_set("dome", poses=24)
    assert data.rigs["dome"].names == tuple(f"00_{k:02d}" for k in (1, 2, 10, 13, 3, 23, 19, 30))
    assert data.layout.name == "panoptic19"
    assert {r.action for r in data.recordings} == {"pose1", "pose2"}


def test_occlusion_person_has_eight_views_and_flags():
    data = synthetic.simulate_set("occlusion-person-like", poses=90)
    assert all(len(rig) == 8 for rig in data.rigs.values())
    assert data.layout.name == "occlusion_person15"
    share = np.mean([r.visible.mean() for r in data.recordings])
    assert 0.6 < share < 0.9


def test_other_layouts_of_the_body_keep_its_joints_and_have_a_symmetric_head():
    body = synthetic.motion("turn", 20, seed=2)
    coco = synthetic.in_layout(body, sk.layouts.COCO17)
    names, source = sk.layouts.COCO17.joints, sk.layouts.H36M17.joints
    for name in ("nose", "left_wrist", "right_ankle"):
        np.testing.assert_array_equal(coco[:, names.index(name)], body[:, source.index(name)])
    nose, left, right = (coco[:, names.index(name)] for name in ("nose", "left_eye", "right_eye"))
    sides = [np.linalg.norm(eye - nose, axis=-1) for eye in (left, right)]
    np.testing.assert_allclose(*sides)
    np.testing.assert_allclose(np.linalg.norm(left - right, axis=-1), 64.0)
    toward = body[:, source.index("left_shoulder")] - body[:, source.index("right_shoulder")]
    assert (((left - right) * toward).sum(axis=-1) > 0).all()


def test_given_occluders_leave_the_rest_of_the_noise_as_it_is():
    rig, body = synthetic.human36m_like(), synthetic.motion("walk", 30, seed=1)
    noise = synthetic.DetectionNoise.good()
    pixels = np.moveaxis(np.asarray(sk.project(body, rig)), 0, 1)
    none = synthetic.draw_occluders(pixels, noise=noise)
    assert not none.hidden(pixels).any()
    detections = synthetic.simulate_detections(body, rig, noise=noise, occluders=none, seed=5)
    assert np.isfinite(detections).all()
    with pytest.raises(sk.InvalidInputError, match="occluded_views: "):
        synthetic.draw_occluders(pixels, noise=synthetic.DetectionNoise.occluded(5))
