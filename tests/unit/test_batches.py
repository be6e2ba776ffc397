"""`refine_batches`: chunks of any size give the bits of one call, in time too, and wrong ones are refused."""

from __future__ import annotations

import itertools
import tracemalloc
import warnings
from collections.abc import Iterator
from dataclasses import fields
from typing import Any

import numpy as np
import pytest

import skelsplat as sk
from skelsplat import synthetic
from skelsplat.synthetic import DetectionNoise

FPS = 10.0  # windows of 600 frames, which overlap by 30
FRAMES = 1300
RIG = synthetic.human36m_like()
JOINTS = [11, 12, 13, 0, 1, 2]  # half of the left side: few, for speed
ARM = sk.Layout("arm", joints=[f"j{k}" for k in range(6)], limbs=[(0, 1), (1, 2), (3, 4), (4, 5)])


def recorded(n_frames: int = FRAMES, seed: int = 3) -> np.ndarray:
    """Simulate detections (T, 4, 6, 3) of six joints that walk back and forth."""
    pose = synthetic.motion("walk", n_frames, fps=FPS, seed=seed)
    seen = synthetic.simulate_detections(pose, RIG, noise=DetectionNoise.recording(FPS), seed=seed)
    return np.ascontiguousarray(seen[:, :, JOINTS])


@pytest.fixture(scope="module")
def seen() -> np.ndarray:
    return recorded()


@pytest.fixture(scope="module")
def whole(seen: np.ndarray) -> sk.SequenceRefinement:
    return sk.refine_sequence(seen, RIG, fps=FPS, layout=ARM)


def cut(frames: np.ndarray, *sizes: int) -> list[np.ndarray]:
    """Cut into chunks of these sizes, and the rest."""
    ends = np.cumsum(sizes)
    return [np.asarray(part) for part in np.split(frames, ends[ends <= len(frames)])]


def same(results: list[Any], expected: Any, but: tuple[str, ...] = ()) -> None:
    """Assert that results hold the bits of one result."""
    for entry in fields(expected):
        name = entry.name
        if name in but:
            continue
        value = getattr(expected, name)
        if name in ("bones", "bone_lengths", "bone_length_sigma", "view_noise"):
            of_all = [getattr(result, name) for result in results if len(result.pose)]
        else:
            of_all = [np.concatenate([getattr(result, name) for result in results])]
        for found in of_all:
            np.testing.assert_array_equal(found, value, err_msg=name)


# frames alone


def test_chunks_of_frames_alone_have_the_bits_of_one_call(seen):
    frames = seen[:40]
    expected = sk.refine(None, frames, RIG, layout=ARM)
    chunks = cut(frames, 0, 1, 0, 7, 20)
    results = list(sk.refine_batches(chunks, RIG, layout=ARM))
    assert [len(result.pose) for result in results] == [0, 1, 0, 7, 20, 12]
    same(results, expected)
    same(list(sk.refine_batches(iter(chunks), RIG, layout=ARM)), expected)
    by_array = list(sk.refine_batches(frames, RIG, layout=ARM, frames_per_chunk=15))
    assert [len(result.pose) for result in by_array] == [15, 15, 10]
    same(by_array, expected)


def test_the_published_method_takes_chunks(seen):
    config = sk.RefineConfig.paper(max_steps=3, resolution=0.1)
    expected = sk.refine(None, seen[:4], RIG, config=config)
    same(list(sk.refine_batches(cut(seen[:4], 3), RIG, config=config)), expected)


# in time


@pytest.mark.parametrize("sizes", [(1300,), (650, 0, 3, 400), (100,) * 12], ids=["one", "uneven", "many"])
def test_chunks_in_time_have_the_bits_of_one_call(seen, whole, sizes):
    results = list(sk.refine_batches(cut(seen, *sizes), RIG, fps=FPS, layout=ARM))
    assert [len(result.pose) for result in results] == [len(part) for part in cut(seen, *sizes)]
    same(results, whole, but=("bone_length_sigma",))
    for result in results:
        if len(result.pose):
            np.testing.assert_allclose(result.bone_length_sigma, whole.bone_length_sigma, rtol=0.2)


def test_a_function_opens_the_chunks_anew_and_may_fill_the_same_array_again(seen, whole):
    opened, given = [], np.empty_like(seen[:100])

    def chunks() -> Iterator[np.ndarray]:
        opened.append(1)
        for k in range(0, FRAMES, 100):
            given[:] = seen[k : k + 100]
            yield given

    same(list(sk.refine_batches(chunks, RIG, fps=FPS, layout=ARM)), whole, but=("bone_length_sigma",))
    assert len(opened) == 3


def test_memory_does_not_grow_with_the_recording(seen):
    def most(n: int) -> int:
        tracemalloc.start()
        chunks = cut(seen, *(130,) * 9)
        for result in sk.refine_batches(lambda: itertools.islice(itertools.cycle(chunks), n), RIG, fps=FPS):
            del result
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return peak

    assert most(60) < 1.1 * most(30)


# what is refused


@pytest.mark.parametrize("fps", [None, FPS])
def test_wrong_chunks_are_named(seen, fps):
    frames, unequal = seen[:5], seen[:5].copy()
    unequal[2, 1, 0, 2] = 3.0
    for wrong, argument in (
        (frames[:, :3], "detections"),
        (frames[:, :, :5], "detections"),
        (frames[0], "detections"),
        (unequal, "detections[2, 1, 0, 2]"),
        ("chunk", "detections"),
    ):
        with pytest.raises(sk.InvalidInputError) as caught:
            list(sk.refine_batches([frames, wrong], RIG, fps=fps))
        assert caught.value.argument == f"chunks[1], {argument}"


@pytest.mark.parametrize(
    ("argument", "given"),
    [
        ("chunks", {"chunks": 5}),
        ("chunks", {"chunks": iter([]), "fps": FPS}),
        ("frames_per_chunk", {"frames_per_chunk": 5}),
        ("frames_per_chunk", {"chunks": np.zeros((3, 4, 6, 2)), "frames_per_chunk": 0}),
        ("fps", {"fps": 0.0}),
        ("config.method", {"fps": FPS, "config": sk.RefineConfig.paper()}),
    ],
)
def test_wrong_arguments_are_refused_at_once(argument, given):
    with pytest.raises(sk.InvalidInputError) as caught:
        sk.refine_batches(**{"chunks": [], "cameras": RIG, **given})
    assert caught.value.argument == argument


def test_a_source_that_changes_is_noticed(seen):
    sizes = iter([300, 200])
    with pytest.raises(sk.InvalidInputError, match="chunks: "):
        list(sk.refine_batches(lambda: [seen[: next(sizes)]], RIG, fps=FPS))


def test_no_chunks_no_results(seen):
    assert list(sk.refine_batches([], RIG)) == list(sk.refine_batches([], RIG, fps=FPS)) == []
    (empty,) = sk.refine_batches([seen[:0]], RIG, fps=FPS, layout=ARM)
    assert empty.pose.shape == (0, 6, 3)


def test_a_wrong_unit_is_warned_of_once(seen):
    rig = [sk.Camera(camera.K, camera.R, camera.t / 1000, size=camera.size) for camera in RIG]
    for given in ({}, {"fps": FPS}):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            list(sk.refine_batches(cut(seen[:30], 10, 10), rig, **given))
        assert len(caught) == 1
        assert caught[0].filename == __file__
