"""`skelsplat datasets`, and what its verification says of spoiled data: nothing about good ones."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import skelsplat as sk
from command_line import invoke, succeed
from skelsplat import synthetic
from skelsplat.datasets import Dataset, Take
from skelsplat.datasets._verify import verify
from skelsplat.synthetic import DetectionNoise, simulate_detections
from writers import human36m as write

N = 17


def dataset(noise=None, *, frames=40, takes=3, distortion=True):
    """Make takes with the projected truth as detections, or with simulated ones."""
    rig = write.rig((0.0, 0.0, 0.0), distortion=distortion)
    made = []
    for k in range(takes):
        truth = synthetic.motion(("walk", "reach", "turn")[k % 3], frames, seed=k)
        model = noise or DetectionNoise(sigma_px=0.0)
        detections = simulate_detections(truth, rig, noise=model, layout="h36m17", seed=k)
        made.append(Take(f"S9/{k}", "S9", "Walking", rig, np.arange(frames), truth, detections))
    return Dataset("human36m", sk.layouts.H36M17, tuple(made))


def changed(data, **parts):
    """Replace parts of all takes: each is a function of a take."""
    takes = tuple(replace(take, **{name: make(take) for name, make in parts.items()}) for take in data)
    return replace(data, takes=takes)


def with_cameras(data, make):
    return changed(data, rig=lambda take: sk.CameraRig([make(c) for c in take.rig], take.rig.unit))


def camera(c, **parts):
    values = {"K": c.K, "R": c.R, "t": c.t, "distortion": c.distortion, "size": c.size, "name": c.name}
    values.update(parts)
    return sk.Camera(values.pop("K"), values.pop("R"), values.pop("t"), **values)


@pytest.mark.parametrize(
    "noise",
    [
        None,
        DetectionNoise.noisy(),
        DetectionNoise.occluded(3, hard=True),
        DetectionNoise(sigma_px=3.0, view_swap_rate=0.2, limb_swap_rate=0.2),
    ],
)
def test_good_data_and_noisy_data_are_not_doubted(noise):
    assert verify(dataset(noise)) == ()


def test_no_detections_and_missing_truth_are_no_finding():
    assert verify(changed(dataset(), detections=lambda _: None)) == ()

    def gaps(take):
        truth = take.truth.copy()
        truth[::2, 3:9] = np.nan
        truth[5] = np.nan
        return truth

    assert verify(changed(dataset(), truth=gaps)) == ()
    assert verify(changed(dataset(), truth=lambda take: np.full_like(take.truth, np.nan))) == ()


@pytest.mark.parametrize(("factor", "unit"), [(0.001, "m"), (0.1, "cm")])
@pytest.mark.parametrize("detections", [True, False])
def test_the_unit_of_the_truth_is_named(factor, unit, detections):
    data = changed(dataset(), truth=lambda take: factor * take.truth)
    if not detections:
        data = changed(data, detections=lambda _: None)
    (finding,) = verify(data)
    assert finding.severity == "error"
    assert finding.kind == "unit_wrong"
    assert finding.numbers["likely_unit"] == unit
    assert finding.subject.takes == ("S9/0", "S9/1", "S9/2")


@pytest.mark.parametrize("factor", [0.001, 10.0])
def test_the_unit_of_the_cameras_is_named(factor):
    data = with_cameras(dataset(DetectionNoise.good()), lambda c: camera(c, t=factor * c.t))
    (finding,) = verify(data)
    assert (finding.kind, finding.severity) == ("unit_wrong", "error")
    assert finding.numbers["factor"] == pytest.approx(1 / factor)


def test_exchanged_sides_of_one_take_and_of_one_view():
    data = dataset(DetectionNoise.good())
    order = np.arange(N)
    for left, right in data.layout.left_right:
        order[[left, right]] = right, left
    takes = list(data.takes)
    takes[1] = replace(takes[1], detections=takes[1].detections[:, :, order])
    (finding,) = verify(replace(data, takes=tuple(takes)))
    assert (finding.kind, finding.severity) == ("sides_swapped", "error")
    assert finding.subject.takes == ("S9/1",)
    for take in data:
        take.detections[:, 2] = take.detections[:, 2][:, order]
    (finding,) = verify(data)
    assert (finding.kind, finding.severity) == ("sides_swapped", "warning")
    assert finding.subject.cameras == ("58860488",)


def test_another_joint_order():
    order = [0, 4, 5, 6, 1, 2, 3, *range(7, N)]  # the legs alone, as in no layout
    data = changed(dataset(DetectionNoise.good()), detections=lambda take: take.detections[:, :, order])
    findings = verify(data)
    (finding,) = [f for f in findings if f.kind == "dataset_joint_order"]
    assert ["right_knee", "left_knee"] in finding.numbers["pairs"]
    assert "right_knee lies on left_knee" in finding.text
    mixed = list(np.random.default_rng(1).permutation(N))
    data = changed(dataset(DetectionNoise.good()), detections=lambda take: take.detections[:, :, mixed])
    assert "dataset_joint_order" in {finding.kind for finding in verify(data)}


def test_cameras_in_another_order():
    data = changed(dataset(DetectionNoise.good()), detections=lambda take: take.detections[:, [1, 0, 2, 3]])
    first, second = [f for f in verify(data) if f.kind == "cameras_exchanged"]
    assert (first.subject.cameras, first.numbers["other"]) == (("54138969",), "55011271")
    assert (second.subject.cameras, second.numbers["other"]) == (("55011271",), "54138969")
    assert first.severity == "warning"


def test_exchanged_tangential_coefficients():
    def exchange(c):
        return camera(c, distortion=np.array(c.distortion)[[0, 1, 3, 2, 4]])

    data = with_cameras(dataset(DetectionNoise(sigma_px=0.5)), exchange)
    (finding,) = verify(data)
    assert finding.kind == "dataset_lens"
    assert finding.numbers == {"likely_lens": "tangential"}


def test_detections_without_distortion():
    data = dataset(DetectionNoise.good())
    ideal = dataset(DetectionNoise.good(), distortion=False)
    takes = [replace(ideal_take, rig=take.rig) for take, ideal_take in zip(data, ideal, strict=True)]
    (finding,) = verify(replace(data, takes=tuple(takes)))
    assert finding.kind == "dataset_lens"
    assert finding.numbers == {"likely_lens": "none"}


def plain(result):
    """All that is printed, without line breaks."""
    return " ".join(result.stdout.split())


@pytest.fixture
def good(tmp_path):
    write.write_skelsplat(tmp_path, write.record())
    return tmp_path


def test_a_good_data_set_is_status_0(good):
    result = succeed("datasets", "check", "human36m", good)
    text = plain(result)
    assert "S11 4 24 4 17 100.0 % 100.0 %" in text
    assert text.count("60457274") == 1
    result = succeed("datasets", "check", "human36m", good, "--json")
    report = json.loads(result.stdout)
    assert (report["ok"], report["format"]) == (True, "skelsplat")
    assert len(report["files"]["there"]) == 1 + 8 + 8 * 4, "cameras, truth, and detections of every view"
    assert report["files"]["missing"] == report["findings"] == []
    first = report["dataset"]["takes"][0]
    assert (first["key"], first["frames"], first["views"]) == ("S9/Directions", 6, list(write.CAMERAS))
    assert report["dataset"]["joints"] == 17
    assert list(report["reprojection_px"]) == list(write.CAMERAS)
    assert all(px < 3 for px in report["reprojection_px"].values())


def test_all_that_is_missing_is_status_1_and_listed(good):
    folder = good / "2d_metrabs" / "S9" / "Directions"
    missing = [folder / camera / "poses.npz" for camera in ("58860488", "60457274")]
    for path in missing:
        path.unlink()
    result = invoke("datasets", "check", "human36m", good)
    assert result.exit_code == 1
    assert all(str(path) in plain(result) for path in missing)
    report = json.loads(invoke("datasets", "check", "human36m", good, "--json").stdout)
    assert [entry["path"] for entry in report["files"]["missing"]] == list(map(str, missing))
    assert report["dataset"] is None
    assert not report["ok"]


def test_options_reach_the_reader(tmp_path):
    recording = write.record()
    write.write_videopose3d(tmp_path, recording)
    write.write_detections(tmp_path / "2d_CPN", recording)
    chosen = ("--detections", tmp_path / "2d_CPN", "--set", "subjects=S9,")
    result = invoke("datasets", "check", "human36m", tmp_path, *chosen, "--json")
    report = json.loads(result.stdout)
    assert report["dataset"]["detector"] == "cpn"
    assert {take["subject"] for take in report["dataset"]["takes"]} == {"S9"}
    (tmp_path / "data_2d_h36m_cpn_ft_h36m_dbb.npz").unlink()
    assert "No detections" in invoke("datasets", "check", "human36m", tmp_path).stdout
