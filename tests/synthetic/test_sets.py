"""Simulated data sets: numbers as in the protocols, same seed same data, occluders that hide."""

from __future__ import annotations

import numpy as np
import pytest

import skelsplat as sk
from skelsplat import synthetic


@pytest.fixture(scope="module")
def plain():
    return synthetic.simulate_set("human36m-like")


def truth_of(recording):
    return recording.arrays["truth"]["poses"]


def seen_by(detector, recording):
    return recording.arrays[f"detections_simulated_{detector}"]["detections"]


def test_the_same_seed_gives_the_same_data_and_another_one_other():
    one, two, other = (synthetic.simulate_set("dome", poses=40, seed=seed) for seed in (3, 3, 4))
    for a, b, c in zip(one.recordings, two.recordings, other.recordings, strict=True):
        for stem, arrays in a.arrays.items():
            for key, values in arrays.items():
                np.testing.assert_array_equal(values, b.arrays[stem][key])
        assert not np.array_equal(truth_of(a), truth_of(c))


def test_a_set_has_a_pose_per_take_at_least():
    with pytest.raises(sk.InvalidInputError, match="poses: "):
        synthetic.simulate_set("human36m-like", poses=59)


@pytest.mark.parametrize(("name", "most"), [("human36m-like-occ-2", 2), ("human36m-like-occ-3", 3)])
def test_occluded_sets_have_the_same_poses(plain, name, most):
    hidden = synthetic.simulate_set(name)
    for a, b in zip(plain.recordings, hidden.recordings, strict=True):
        np.testing.assert_array_equal(truth_of(a), truth_of(b))
        assert "visible" not in a.arrays["truth"]
    visible = [r.arrays["truth"]["visible"] for r in hidden.recordings]
    assert max((~one).any(axis=2).sum(axis=1).max() for one in visible) == most


def test_both_detectors_see_the_same_occluders():
    data = synthetic.simulate_set("human36m-like-occ-3-hard", poses=200)
    hidden = np.concatenate([~r.arrays["truth"]["visible"] for r in data.recordings])
    pixels = [sk.project(truth_of(r), data.rigs["room"]).swapaxes(0, 1) for r in data.recordings]
    for name in ("good", "noisy"):
        found = np.concatenate([seen_by(name, r)[..., :2] for r in data.recordings])
        wrong = np.linalg.norm(found - np.concatenate(pixels), axis=-1) > 15.0
        assert wrong[hidden].mean() > 0.8, "what is hidden is detected at a wrong place"
        assert wrong[~hidden].mean() < 0.1


def test_fusion_of_the_monocular_poses_errs_forty_millimetres(plain):
    rig, errors = plain.rigs["room"], []
    for r in plain.recordings:
        fused = sk.fuse_monocular(r.arrays["monocular_simulated"]["poses"], seen_by("good", r), rig)
        errors.append(np.linalg.norm(fused - truth_of(r), axis=-1))
    assert 37.0 < np.concatenate(errors).mean() < 43.0


def test_the_dome_and_occlusion_person_have_the_cameras_and_joints_of_their_models():
    dome = synthetic.simulate_set("dome", poses=24)
    assert dome.rigs["dome"].names == tuple(f"00_{k:02d}" for k in (1, 2, 10, 13, 3, 23, 19, 30))
    assert dome.layout.name == "panoptic19"
    assert {r.action for r in dome.recordings} == {"pose1", "pose2"}
    person = synthetic.simulate_set("occlusion-person-like", poses=90)
    assert all(len(rig) == 8 for rig in person.rigs.values())
    assert person.layout.name == "occlusion_person15"
    assert 0.6 < np.mean([r.arrays["truth"]["visible"].mean() for r in person.recordings]) < 0.9


def test_other_layouts_of_the_body_keep_its_joints_and_have_a_symmetric_head():
    body = synthetic.motion("turn", 20, seed=2)
    coco = synthetic.in_layout(body, sk.layouts.COCO17)
    names, source = sk.layouts.COCO17.joints, sk.layouts.H36M17.joints
    for name in ("nose", "left_wrist", "right_ankle"):
        np.testing.assert_array_equal(coco[:, names.index(name)], body[:, source.index(name)])
    nose, left, right = (coco[:, names.index(name)] for name in ("nose", "left_eye", "right_eye"))
    np.testing.assert_allclose(*(np.linalg.norm(eye - nose, axis=-1) for eye in (left, right)))
    np.testing.assert_allclose(np.linalg.norm(left - right, axis=-1), 64.0)
    toward = body[:, source.index("left_shoulder")] - body[:, source.index("right_shoulder")]
    assert (((left - right) * toward).sum(axis=-1) > 0).all()
