"""Scenes of several people: what is said about their detections is true, and every effect can be found."""

from __future__ import annotations

import numpy as np
import pytest

import skelsplat as sk
from skelsplat import InvalidInputError, synthetic
from skelsplat.synthetic import Crowding, DetectionNoise
from skelsplat.synthetic.crowding import behind
from skelsplat.synthetic.crowds import ROOM_MM

RIG = synthetic.ring(4, radius_mm=4500.0)
EXACT = DetectionNoise(sigma_px=0.0)
NONE = Crowding.none()


def scene(people=3, *, n_frames=150, noise=EXACT, crowding=NONE, **options):
    return synthetic.simulate_scene(
        people, RIG, n_frames=n_frames, noise=noise, crowding=crowding, **{"seed": 1, **options}
    )


def there(found):
    return np.isfinite(found.people[..., 0])


def only(**rates):
    """Nothing goes wrong but this."""
    off = {"hidden_missing": 0, "hidden_taken": 0, "miss_rate": 0, "merge_rate": 0, "split_rate": 0}
    return Crowding(**{**off, "ghosts": 0, "ghost_rate": 0, **rates})


def true_pixels(found):
    """Projections of the truth, (Q, T, M, N, 2)."""
    return np.moveaxis(np.asarray(sk.project(found.truth, found.cameras)), 0, 2)


def errors(found):
    """Distance of every joint from the person whom it shows, (T, M, P, N) px; NaN where it shows nobody."""
    pixels = true_pixels(found)
    frame, view = np.arange(pixels.shape[1])[:, None, None, None], np.arange(pixels.shape[2])[:, None, None]
    own = pixels[found.joint_owner, frame, view, np.arange(pixels.shape[3])]
    distance = np.linalg.norm(found.people[..., :2] - own, axis=-1)
    return np.where(found.joint_owner >= 0, distance, np.nan)


def test_an_exact_detector_sees_each_person_once_where_they_are():
    found = scene()
    assert np.nanmax(errors(found)) < 1e-9
    for q in range(3):
        assert (found.owner == q).sum(axis=-1).max() == 1
    np.testing.assert_array_equal(there(found), found.joint_owner >= 0)
    seen = np.isfinite(found.detections()[..., 0])
    whole = seen.sum(axis=-1) >= 3
    np.testing.assert_array_equal(seen[whole], found.visible[whole])
    np.testing.assert_array_equal(found.optional(), (found.slots() >= 0).sum(axis=-1) < 2)


def test_same_seed_same_scene_and_people_do_not_depend_on_the_detector():
    one, same = (scene(crowding=Crowding(), noise=None) for _ in range(2))
    np.testing.assert_array_equal(one.people, same.people)
    np.testing.assert_array_equal(one.owner, same.owner)
    np.testing.assert_array_equal(one.truth, scene().truth)
    assert not np.array_equal(one.truth, scene(seed=2).truth)


def test_who_stands_in_front_hides():
    pixels = np.zeros((3, 1, 2, 2))
    pixels[:, 0, 1] = (0.0, 100.0)  # three people as vertical lines …
    pixels[1, ..., 0] = 30.0
    pixels[2, ..., 0] = 300.0
    depth = np.full((3, 1, 2), 4000.0)
    depth[1] = 3000.0  # … of which the middle one is nearer
    layout = sk.Layout("line", ["neck", "pelvis"], limbs=[(0, 1)])
    hidden = behind(pixels, depth, 1000.0, layout)
    # A trunk of 120 mm at 3 m covers 40 px to either side.
    np.testing.assert_array_equal(hidden[:, 0], [[1, 1], [-1, -1], [-1, -1]])
    arm = sk.Layout("line", ["elbow", "wrist"], limbs=[(0, 1)])  # 60 mm: 20 px
    assert (behind(pixels, depth, 1000.0, arm) == -1).all()
    assert (behind(pixels, np.full((3, 1, 2), 4000.0), 1000.0, layout) == -1).all()


def test_hidden_joints_are_missing_taken_or_guessed():
    visible = scene().visible
    assert 0.02 < 1 - visible.mean() < 0.3
    taken = scene(crowding=only(hidden_taken=1.0))
    shows = taken.joint_owner
    wrong = there(taken) & (shows != taken.owner[..., None]) & (taken.owner[..., None] >= 0)
    assert wrong.any()
    assert np.nanmedian(errors(taken)[wrong]) < 10.0  # near the same joint of the one in front
    guessed = scene(crowding=only())
    np.testing.assert_array_equal(guessed.joint_owner[there(guessed)] >= 0, True)
    assert np.isfinite(guessed.detections()[..., 0]).mean() > np.isfinite(scene().detections()[..., 0]).mean()
    assert 5.0 < np.nanmean(errors(guessed)[errors(guessed) > 1e-6]) < 50.0


def test_two_people_become_one_detection_with_joints_of_both():
    found = scene(crowding=only(hidden_missing=1.0, merge_rate=1.0))
    owners = [set(np.unique(own[own >= 0]).tolist()) for own in found.joint_owner.reshape(-1, 17)]
    mixed = [own for own in owners if len(own) == 2]
    assert len(mixed) > 50
    assert np.nanmax(errors(found)) < 1e-9
    assert (found.slots() < 0).sum() > (scene().slots() < 0).sum() + 50


def test_one_person_becomes_two_detections():
    found = scene(crowding=only(hidden_missing=1.0, split_rate=1.0))
    for q in range(3):
        own = found.owner == q
        assert (own.sum(axis=-1) == 2).mean() > 0.8
        # No joint is in both halves.
        assert (there(found) & own[..., None]).sum(axis=2).max() == 1


def test_false_detections_stay_or_are_gone_at_once():
    found = scene(n_frames=300, crowding=only(hidden_missing=1.0, ghosts=2.0), seed=3)
    false = there(found).any(axis=-1) & (found.owner < 0)
    assert 4 <= false.sum(axis=-1).max(axis=0).sum() <= 16
    assert false[:-1].mean() > 0.05
    # They do not move: the sum of the left edges of those of a view takes few values.
    view = int(false.sum(axis=(0, 2)).argmax())
    edges = np.nanmin(np.where(false[:, view, :, None], found.people[:, view, ..., 0], np.nan), axis=(1, 2))
    assert len(np.unique(np.round(edges[np.isfinite(edges)] / 20.0))) < 12
    brief = scene(n_frames=600, crowding=only(hidden_missing=1.0, ghost_rate=0.1))
    assert (brief.owner[there(brief).any(axis=-1)] < 0).mean() == pytest.approx(0.1 / 3.1, rel=0.6)


def test_ones_own_poses_keep_their_place_and_absences():
    poses = [synthetic.motion("walk", 40, seed=k) + 500.0 * k for k in range(3)]
    poses[1][10:20] = np.nan
    found = scene(poses)
    np.testing.assert_array_equal(found.truth, poses)
    assert (found.slots()[1, 10:20] == -1).all()
    assert found.optional()[1, 10:20].all()
    assert not found.optional()[0].any()


FPS = 30.0
WRISTS = [13, 16]


def nearest(people):
    """Least distance of two pelvises, mm, and the frame."""
    gap = np.linalg.norm(people[0, :, 0, :2] - people[1, :, 0, :2], axis=-1)
    return np.nanmin(gap), int(np.nanargmin(gap))


@pytest.mark.parametrize("kind", synthetic.meeting_names)
@pytest.mark.parametrize("count", [1, 5])
def test_people_stay_in_the_room_on_the_floor_and_walk_at_a_human_pace(kind, count):
    people = synthetic.crowd(count, 300, fps=FPS, meetings=[kind], seed=count)
    assert people.shape == (count, 300, 17, 3)
    pelvis = people[:, :, 0]
    assert np.nanmax(np.linalg.norm(pelvis[..., :2], axis=-1)) < ROOM_MM + 100.0
    assert np.nanmax(np.linalg.norm(np.diff(pelvis, axis=1), axis=-1)) * FPS < 3000.0
    feet = people[..., 2].min(axis=2)
    assert np.nanmin(feet) > 30.0
    assert np.nanmax(feet) < 130.0
    assert np.isnan(people).any() == (kind == "leave" and count > 1)


@pytest.mark.parametrize("seed", range(2))
def test_people_who_cross_pass_at_arms_length(seed):
    gap, frame = nearest(synthetic.crowd(2, 150, fps=FPS, meetings=["cross"], seed=seed))
    assert 295.0 < gap < 610.0
    assert frame == pytest.approx(2.5 * FPS, abs=2)


def test_one_stands_behind_the_other_seen_from_a_camera():
    eyes = np.array([[4500.0, 0.0, 1500.0]])
    people = synthetic.crowd(2, 150, fps=FPS, meetings=["behind"], eyes=eyes, seed=2)
    towards = eyes[0, :2] - people[:, 75, 0, :2]
    towards /= np.linalg.norm(towards, axis=1)[:, None]
    assert towards[0] @ towards[1] > np.cos(np.deg2rad(1.0))


@pytest.mark.parametrize(
    ("make", "argument"),
    [
        (lambda: Crowding(hidden_missing=0.7, hidden_taken=0.4), "hidden_missing + hidden_taken"),
        (lambda: scene([np.zeros((5, 17, 3)), np.zeros((6, 17, 3))]), "people"),
        (lambda: synthetic.simulate_scene(2, sk.CameraRig(list(RIG), "m")), "cameras"),
        (lambda: synthetic.crowd(0, 60), "n_people, n_frames"),
        (lambda: synthetic.crowd(2, 60, meetings=["dance"]), "meetings"),
    ],
)
def test_what_makes_no_scene_is_refused(make, argument):
    with pytest.raises(InvalidInputError) as caught:
        make()
    assert caught.value.argument == argument
