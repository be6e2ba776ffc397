"""Reading detections: every format to the same arrays, and the main person among others in each."""

from __future__ import annotations

import numpy as np
import pytest

import skelsplat as sk
from broken_detections import NAMES, anybody, write_case
from detection_cases import CASES
from detection_files import Take
from skelsplat import synthetic
from skelsplat.io import read_detections

T = 4
MISSING = (1, -1, 5)  # frame, camera, joint
LABELS = {  # of the views in a file of all cameras, if they are not their places
    "videopose3d": ["54138969", "55011271", "58860488", "60457274"],
    "caliscope": ["1", "2", "3", "4"],
    "caliscope_ports": ["1", "2", "3", "4"],
}


@pytest.fixture(scope="module")
def rig():
    return synthetic.human36m_like()


def seen(pose, rig, views, seed):
    """Make detections (T, M, K, 3) of one person with 1 px of noise; nobody outside `views`."""
    rng = np.random.default_rng(seed)
    pixels = sk.project(pose, rig).swapaxes(0, 1)
    pixels = pixels + rng.normal(0.0, 1.0, pixels.shape)
    found = np.concatenate([pixels, rng.uniform(0.4, 1.0, (*pixels.shape[:-1], 1))], axis=-1)
    found[:, [m for m in range(len(rig)) if m not in views]] = np.nan
    return found


@pytest.fixture(scope="module")
def people(rig):
    """Two people (T, M, 2, K, 3); the second in two views only, and there the two change places."""
    pose = synthetic.motion("walk", T, seed=3)
    person = seen(pose, rig, range(4), 1)
    person[MISSING] = np.nan
    bystander = seen(pose[::-1] + np.array([900.0, 700.0, 0.0]), rig, (0, 1), 2)
    both = np.stack([person, bystander], axis=2)
    both[::2, 0] = both[::2, 0, ::-1]
    both[1::2, 1] = both[1::2, 1, ::-1]
    return both


@pytest.fixture(scope="module")
def place():
    """Where the person is, (T, M)."""
    index = np.zeros((T, 4), dtype=np.int64)
    index[::2, 0] = index[1::2, 1] = 1
    return index


def alone(people, place):
    return np.take_along_axis(people, place[:, :, None, None, None], axis=2)


def written(case, root, people, place, rig, first=5):
    """Write a case; return the path and what is to be read (T, M, P, K, 3)."""
    kept = people if case.people else alone(people, place)
    layout = sk.layouts.get(case.layout)
    path = case.write(root, Take(kept, list(rig.names), list(layout.joints), first))
    expected = kept.astype(case.precision).astype(np.float64)
    if not case.confidence:
        expected[..., 2] = np.where(np.isfinite(expected[..., 0]), 1.0, np.nan)
    return path, expected


def read(case, path, rig, **options):
    return read_detections(path, rig, **{"layout": case.layout, "order": case.order, **options})


@pytest.mark.parametrize("name", CASES)
def test_every_format_is_found_and_read_to_the_same_arrays(tmp_path, people, place, rig, name):
    case = CASES[name]
    path, expected = written(case, tmp_path, people, place, rig)
    found = read(case, path, rig)
    np.testing.assert_array_equal(found.people, expected)
    np.testing.assert_array_equal(found.frames, np.arange(T) + (5 if case.frames else 0))
    assert found.format == case.format
    assert found.layout == case.layout
    assert found.camera_names == rig.names
    assert all(source is not None and source.is_relative_to(tmp_path) for source in found.sources)
    assert np.isnan(found.people[MISSING[0], MISSING[1], 0, MISSING[2]]).all()
    named = read(case, path, rig, format=case.format)
    np.testing.assert_array_equal(named.people, expected)


@pytest.mark.parametrize("name", CASES)
def test_views_follow_the_cameras(tmp_path, people, place, rig, name):
    case = CASES[name]
    path, expected = written(case, tmp_path, people, place, rig)
    backward = list(rig)[::-1]
    labels = LABELS.get(name, ["0", "1", "2", "3"])
    order = None if case.order is None else labels[::-1]
    np.testing.assert_array_equal(read(case, path, backward, order=order).people, expected[:, ::-1])


@pytest.mark.parametrize("name", CASES)
def test_offsets_shift_a_camera_in_time(tmp_path, people, place, rig, name):
    case = CASES[name]
    path, expected = written(case, tmp_path, people, place, rig)
    first = 5 if case.frames else 0
    offsets = {rig.names[1]: 2, rig.names[3]: np.int64(-1)}
    found = read(case, path, rig, offsets=offsets, frames="intersection")
    np.testing.assert_array_equal(found.frames, [first + 2])
    for m, at in enumerate((2, 0, 2, 3)):
        np.testing.assert_array_equal(found.people[0, m], expected[at, m])


def test_offsets_are_for_cameras_and_numbers(tmp_path, people, place, rig):
    path, expected = written(CASES["openpose"], tmp_path, people, place, rig)
    strict = read_detections(path, rig, layout="h36m17", offsets={rig.names[0]: 1})
    np.testing.assert_array_equal(strict.frames, [6, 7, 8])
    np.testing.assert_array_equal(strict.people[:, 0], expected[:3, 0])
    np.testing.assert_array_equal(strict.people[:, 1], expected[1:, 1])
    union = read_detections(path, rig, layout="h36m17", offsets={rig.names[0]: 1}, frames="union")
    np.testing.assert_array_equal(union.frames, [5, 6, 7, 8, 9])
    assert np.isnan(union.people[0, 0]).all()
    with pytest.raises(sk.InvalidInputError, match="offsets"):
        read_detections(path, rig, layout="h36m17", offsets={"cam9": 1})
    with pytest.raises(sk.InvalidInputError, match=r"offsets\[\w+\]"):
        read_detections(path, rig, layout="h36m17", offsets={rig.names[0]: "3"})
    with pytest.raises(sk.DatasetError, match="frames"):
        read_detections(path, rig, layout="h36m17", offsets={rig.names[0]: 10})


@pytest.mark.parametrize("name", ["coco", "csv", "sleap_csv"])
def test_a_frame_without_people_is_not_listed_and_not_an_error(tmp_path, people, place, rig, name):
    people = people.copy()
    people[2, 1] = np.nan
    path, expected = written(CASES[name], tmp_path, people, place, rig)
    np.testing.assert_array_equal(read(CASES[name], path, rig).people, expected)


@pytest.mark.parametrize("name", ["rtmlib_frames", "mmpose", "coco", "sleap"])
def test_scores_that_are_no_probabilities_are_clipped(tmp_path, people, place, rig, name):
    people = people.copy()
    people[0, 2, 0, 3, 2], people[0, 2, 0, 4, 2] = 1.7, -0.2
    path, _ = written(CASES[name], tmp_path, people, place, rig)
    found = read(CASES[name], path, rig).people
    np.testing.assert_array_equal(found[0, 2, 0, 3], [*people[0, 2, 0, 3, :2], 1.0])
    assert np.isnan(found[0, 2, 0, 4]).all()


@pytest.mark.parametrize("name", ["openpose", "npz_cameras", "csv"])
def test_parts_of_the_image_for_pixels(tmp_path, people, place, rig, name):
    case = CASES[name]
    path, _ = written(case, tmp_path, people / [1000.0, 1000.0, 1.0], place, rig)
    with pytest.raises(sk.DatasetError, match="keypoints: expected pixels"):
        read(case, path, rig)


def test_deeplabcut_writes_minus_one_for_an_individual_that_it_does_not_find(tmp_path):
    people = anybody()
    people[1, 0, 1] = -1.0
    path = write_case(tmp_path, "deeplabcut_csv_multi", people=people)
    found = read_detections(path, NAMES, layout="h36m17").people
    assert np.isnan(found[1, 0, 1]).all()
    np.testing.assert_array_equal(found[1, 0, 0], people[1, 0, 0])


def test_zeros_with_a_confidence_are_missing_if_there_are_several(tmp_path):
    people = anybody()
    people[0, 0, 0, 3, :2] = people[2, 0, 1, 5, :2] = people[1, 1, 0, 7, :2] = 0.0  # two in camA, one in camB
    path = write_case(tmp_path, "openpose", people=people)
    found = read_detections(path, NAMES, layout="h36m17").people
    assert np.isnan(found[0, 0, 0, 3]).all()
    assert np.isnan(found[2, 0, 1, 5]).all()
    np.testing.assert_array_equal(found[1, 1, 0, 7], people[1, 1, 0, 7])
    assert np.isnan(found).sum() == 6
