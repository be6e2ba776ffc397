"""`skelsplat.scale`: Dask's tasks, in this process and in others, have the bits of one call."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from typing import Any

import numpy as np
import pytest

import skelsplat as sk
from skelsplat import scale, synthetic
from skelsplat.synthetic import DetectionNoise

dask = pytest.importorskip("dask", reason="needs skelsplat[scale]")
da = pytest.importorskip("dask.array", reason="needs skelsplat[scale]")
distributed = pytest.importorskip("distributed", reason="needs skelsplat[scale]")
xr = pytest.importorskip("xarray", reason="needs skelsplat[scale]")

FPS = 10.0  # windows of 600 frames, which overlap by 30
RIG = synthetic.human36m_like()
TRUNK = [0, 1, 4, 7, 8]
LAYOUT = sk.Layout("trunk", joints=list("abcde"), limbs=[(0, 1), (0, 2), (0, 3), (3, 4)])


def recorded(n_frames: int, seed: int = 1) -> np.ndarray:
    """Simulate detections (T, 4, 5, 3)."""
    pose = synthetic.motion("walk", n_frames, fps=FPS, seed=seed)
    seen = synthetic.simulate_detections(pose, RIG, noise=DetectionNoise.recording(FPS), seed=seed)
    return np.ascontiguousarray(seen[:, :, TRUNK])


@pytest.fixture(scope="module")
def seen() -> np.ndarray:
    return recorded(1300)


@pytest.fixture
def processes() -> Iterator[Any]:
    with (
        dask.config.set({"distributed.scheduler.active-memory-manager.start": False}),
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client


def same(dataset: Any, expected: sk.Refinement) -> None:
    """Assert that a computed dataset has the fields and bits of a result."""
    names = {entry.name for entry in fields(expected)} - {"loss_history"}
    assert set(dataset.data_vars) == names
    for name in names:
        np.testing.assert_array_equal(dataset[name].values, getattr(expected, name), err_msg=name)


def test_processes_have_the_bits_of_one(seen, processes):
    other = recorded(200, seed=2)
    lazy = [
        scale.refine(da.from_array(frames, chunks=(170, 2, 5, 3)), RIG, fps=FPS, layout=LAYOUT)
        for frames in (seen, other)
    ]
    alone = scale.refine(da.from_array(other), RIG, layout=LAYOUT, frames_per_block=90)
    found = dask.compute(*lazy, alone)
    same(found[0], sk.refine_sequence(seen, RIG, fps=FPS, layout=LAYOUT))
    same(found[1], sk.refine_sequence(other, RIG, fps=FPS, layout=LAYOUT))
    same(found[2], sk.refine(None, other, RIG, layout=LAYOUT))
    (workers,) = {len(processes.scheduler_info()["workers"])}
    assert workers == 2
    wrong = seen.copy()
    wrong[1290, 0, 0, 2] = 7.0
    dataset = scale.refine(da.from_array(wrong), RIG, fps=FPS)
    with pytest.raises(
        sk.InvalidInputError, match=r"frames \d+ to 1299, detections\[\d+, 0, 0, 2\]: expected"
    ):
        dataset.pose.compute()


def test_a_task_is_a_window_and_one_learns(seen):
    dataset = scale.refine(seen, RIG, fps=FPS, layout=LAYOUT)
    assert dataset.pose.data.chunks[0] == (433, 433, 434)
    tasks = [str(key) for key in dataset.pose.__dask_graph__()]
    assert sum(task.startswith("_solve") for task in tasks) == 3
    assert sum(task.startswith("_learn") for task in tasks) == 1


def test_coordinates_of_the_time_and_facts_are_kept(seen):
    times = np.arange(20) / FPS
    labels = {"t": times, "trial": ("t", np.arange(20) // 10), "uv": list("uvc")}
    given = xr.DataArray(seen[:20], dims=("t", "camera", "keypoint", "uv"), coords=labels)
    rig = sk.CameraRig(list(RIG), unit="mm")
    dataset = scale.refine(given, rig, fps=FPS).compute(scheduler="sync")
    same(dataset, sk.refine_sequence(seen[:20], RIG, fps=FPS))
    assert set(dataset.coords) == {"time", "trial"}
    np.testing.assert_array_equal(dataset.time, times)
    assert dataset.attrs == {"unit": "mm", "fps": FPS}
    assert dataset.pose.dims == ("time", "joint", "space")


def test_a_bone_that_no_window_sees_has_no_length(seen):
    hidden = seen.copy()
    hidden[:, :, 4] = np.nan
    dataset = scale.refine(hidden, RIG, fps=FPS, layout=LAYOUT).compute(scheduler="sync")
    same(dataset, sk.refine_sequence(hidden, RIG, fps=FPS, layout=LAYOUT))
    assert np.isnan(dataset.bone_lengths[3])


@pytest.mark.parametrize("fps", [None, FPS])
def test_nothing_gives_nothing(fps):
    dataset = scale.refine(np.empty((0, 4, 5, 2)), RIG, fps=fps, layout=LAYOUT).compute(scheduler="sync")
    assert dataset.pose.shape == (0, 5, 3)


@pytest.mark.parametrize(
    ("argument", "given"),
    [
        ("detections", {"detections": [[1.0]]}),
        ("detections", {"detections": np.ones((9, 3, 5, 2))}),
        ("fps", {"fps": -1.0}),
        ("frames_per_block", {"fps": FPS, "frames_per_block": 5}),
        ("frames_per_block", {"frames_per_block": 0}),
        ("config.method", {"fps": FPS, "config": sk.RefineConfig.paper()}),
    ],
)
def test_wrong_arguments_are_refused_at_once(seen, argument, given):
    with pytest.raises(sk.InvalidInputError) as caught:
        scale.refine(**{"detections": seen[:9], "cameras": RIG, **given})
    assert caught.value.argument == argument


def test_without_dask_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "dask", None)
    with pytest.raises(sk.MissingPackageError, match=r"pip install 'skelsplat\[scale\]'"):
        scale.refine(np.ones((1, 4, 5, 2)), RIG)
