"""Cameras of different frame rates: put in step where they are read, once for everything."""

from __future__ import annotations

import json

import numpy as np
import pytest

import skelsplat as sk
from command_line import assert_fails, invoke, read_report, succeed
from skelsplat._clocks import shifted
from skelsplat.io import read_calibration, read_npz, write_calibration
from skelsplat.io.detections import read_detections
from skelsplat.run.calibrate import calibrate_cameras
from skelsplat.synthetic import DetectionNoise, motion, ring, simulate_detections

RATES = {"cam1": 30, "cam2": 60, "cam3": 25, "cam4": 50}
LATE = {"cam2": 13, "cam4": -21}  # frames of their own that they are ahead
FINE, SECONDS, LEAD = 300, 12, 300
RIG = sk.CameraRig(
    [sk.cameras.altered(camera, name=name) for camera, name in zip(ring(4), RATES, strict=True)]
)
NAMES, LAYOUT = list(RATES), {"layout": "h36m17"}
FPS = ",".join(f"{name}={rate}" for name, rate in RATES.items())
READ = ["--unit", "mm", "--layout", "h36m17"]


@pytest.fixture(scope="module")
def path():
    """Return joints (T, N, 3) 300 times a second of somebody who walks, not periodically."""
    pace = np.cumsum(np.rint(4 + 2 * np.sin(np.cumsum(np.linspace(0.002, 0.02, FINE * SECONDS + 2 * LEAD)))))
    return motion("walk", int(pace[-1]) + 1, fps=4 * FINE, seed=3)[pace.astype(int)]


def film(path, name, rate, late=0.0):
    """Return what a camera (T, N, 3) records at a rate, so many of its frames ahead."""
    begin = LEAD - round(late * FINE / rate)
    moments = path[begin :: FINE // rate][: SECONDS * rate]
    noise = DetectionNoise.recording(rate)
    return simulate_detections(moments, RIG, noise=noise, seed=3)[:, NAMES.index(name)]


def truth(path, rate, frames):
    return path[LEAD :: FINE // rate][frames]


def write(folder, views, **stated):
    """Write one file per camera, with numbers or a rate if they are given by camera."""
    folder.mkdir()
    for name, view in views.items():
        more = {key: values[name] for key, values in stated.items() if name in values}
        np.savez(folder / f"{name}.npz", detections=view, **more)
    write_calibration(folder.parent / "Calib.toml", RIG)
    return folder


@pytest.fixture(scope="module")
def room(tmp_path_factory, path):
    """Write a walk filmed in step, ``even``, and with late cameras, ``late``."""
    top = tmp_path_factory.mktemp("rates")
    write(top / "even", {name: film(path, name, rate) for name, rate in RATES.items()})
    late = {name: film(path, name, rate, LATE.get(name, 0)) for name, rate in RATES.items()}
    write(top / "late", late)
    return top


def error_of(pose, path, rate, frames):
    return np.nanmean(np.linalg.norm(pose - truth(path, rate, frames), axis=-1))


def test_poses_are_as_good_as_with_one_rate(path):
    """Linear interpolation between detections costs less than 3 %."""
    given = {"fps": 25, **LAYOUT}
    equal = np.stack([film(path, name, 25) for name in RATES], axis=1)
    views, rate = sk.retimed([film(path, *one) for one in RATES.items()], [*RATES.values()])
    assert (rate, len(views)) == (25, 25 * SECONDS)
    errors = [
        error_of(sk.refine_sequence(seen, RIG, **given).pose, path, 25, np.arange(len(seen)))
        for seen in (equal, views)
    ]
    assert errors[1] < 1.03 * errors[0]
    np.testing.assert_array_equal(views[:, 2], film(path, "cam3", 25))  # the slowest is as it was


def test_a_run_puts_rates_and_offsets_right(room, path, tmp_path):
    offsets = [word for name, late in LATE.items() for word in ("--offset", f"{name}={-late}")]
    command = ["refine", room / "Calib.toml", room / "late", *READ, *offsets, "--no-html", "--write", "csv"]
    rates = "\n".join(f"{name} = {rate}" for name, rate in RATES.items())
    (tmp_path / "run.toml").write_text(f"[refine.fps]\n{rates}\n")
    succeed(*command, "--config", tmp_path / "run.toml", "-o", tmp_path / "out")
    report = read_report(tmp_path / "out")["input"]
    assert (report["frame_rate_hz"], report["frame_rates_hz"]) == (25, RATES)
    poses = read_npz(tmp_path / "out" / "pose.npz")
    assert poses.frame_rate == 25
    equal = sk.refine_sequence(
        np.stack([film(path, name, 25) for name in RATES], axis=1), RIG, fps=25, **LAYOUT
    )
    usual = error_of(equal.pose, path, 25, np.arange(25 * SECONDS))
    assert error_of(poses.pose, path, 25, poses.frames) < 1.03 * usual
    assert not [one for one in read_report(tmp_path / "out")["findings"] if "rate" in one["kind"]]


def test_calibrate_finds_clocks_in_frames_of_each_camera(room, tmp_path):
    found = calibrate_cameras(room / "late", room / "Calib.toml", clock=True, fps=RATES, **LAYOUT)
    clocks = {one.name: one.clock for one in found.found.report}
    for name in NAMES:
        assert abs(clocks[name] - LATE.get(name, 0)) < 0.5
    write_calibration(tmp_path / "found.toml", found.found.cameras)
    seen = read_detections(room / "late", read_calibration(tmp_path / "found.toml"), fps=RATES, **LAYOUT)
    (person,) = found.in_step()
    both = np.isin(np.arange(len(person)), seen.frames)
    moved = np.abs(seen.people[: both.sum(), :, 0] - person[both])[..., :2]
    assert np.nanmedian(moved) < 0.5
    assert np.nanmean(moved) < 2.0


def test_a_late_camera_is_named_in_its_own_frames(room, path, tmp_path):
    command = [room / "Calib.toml", room / "late", *READ, "--fps", FPS]
    result = succeed("adjust-cameras", *command, "-o", tmp_path / "synced.toml", "--clock")
    assert "frame numbers were 21.1" in result.stdout
    clocks = read_calibration(tmp_path / "synced.toml").clocks
    for name in NAMES:
        assert abs(clocks.get(name, 0.0) - LATE.get(name, 0)) < 0.5
    late = {name: film(path, name, rate, 24 * (name == "cam2"))[: 6 * rate] for name, rate in RATES.items()}
    command[1] = write(tmp_path / "late", late)
    found = json.loads(invoke("check-cameras", *command, "--without", "cam4", "--json").stdout)
    options = {row["name"]: row["offset_option"] for row in found["cameras"]}
    assert options == {"cam1": None, "cam2": -24.0, "cam3": None}


def figures(rate, count, first=0):
    """Return a figure (T, 1, 17, 3) that moves by 300 px a second, from a first frame's instant on."""
    start = np.random.default_rng(0).uniform(100, 400, (17, 3)) * [1.0, 1.0, 0.0] + [0.0, 0.0, 0.5]
    times = (np.arange(count) + first) / rate
    return (start + times[:, None, None] * [300.0, 0.0, 0.0])[:, None]


def test_files_that_state_their_rates_are_read_at_the_instants_of_the_slowest(tmp_path):
    rates = {"cam1": 24.0, "cam2": 60.0}
    write(tmp_path / "pose", {name: figures(rate, 60) for name, rate in rates.items()}, frame_rate=rates)
    found = read_detections(tmp_path / "pose", ["cam1", "cam2"], **LAYOUT)
    assert found.frame_rate == 24.0
    np.testing.assert_array_equal(found.frames, np.arange(24))  # to 59/60 s
    np.testing.assert_allclose(found.people[:, 0], found.people[:, 1], atol=1e-9)
    given = read_detections(tmp_path / "pose", ["cam1", "cam2"], fps={"cam2": 24}, **LAYOUT)
    assert (given.frame_rate, len(given.frames)) == (24.0, 60)
    alike = read_detections(tmp_path / "pose", ["cam1", "cam2"], fps=30, **LAYOUT)
    assert (alike.frame_rate, len(alike.frames)) == (30, 60)


@pytest.mark.parametrize("first", [0, 1])
def test_cameras_count_from_the_same_instant(tmp_path, first):
    rates = {"cam1": 25.0, "cam2": 50.0}
    frames = {name: first + np.arange(40) for name in rates}
    write(tmp_path / "pose", {name: figures(rate, 40) for name, rate in rates.items()}, frames=frames)
    found = read_detections(tmp_path / "pose", ["cam1", "cam2"], fps=rates, **LAYOUT)
    np.testing.assert_array_equal(found.frames, first + np.arange(20))
    np.testing.assert_allclose(found.people[:, 0], found.people[:, 1], atol=1e-9)


def test_nothing_is_made_up_in_a_gap(tmp_path):
    rates, frames = {"cam1": 20.0, "cam2": 50.0}, np.delete(np.arange(50), np.arange(20, 31))
    views = {"cam1": figures(20, 20), "cam2": figures(50, 50)[frames]}
    numbers = {"cam1": np.arange(20), "cam2": frames}
    write(tmp_path / "pose", views, frames=numbers)
    found = read_detections(tmp_path / "pose", ["cam1", "cam2"], fps=rates, frames="union", **LAYOUT)
    known = np.isfinite(found.people[:, 1, 0, 0, 0])
    np.testing.assert_array_equal(found.frames[~known], [8, 9, 10, 11, 12])  # instants of 20 to 30
    np.testing.assert_allclose(found.people[known, 0], found.people[known, 1], atol=1e-9)
    with pytest.raises(sk.DatasetError, match=r"no frame 8 to 12 in cam2"):
        read_detections(tmp_path / "pose", ["cam1", "cam2"], fps=rates, **LAYOUT)


def test_clocks_of_a_faster_camera_are_in_its_frames():
    seen = figures(60, 90)[:, 0]
    moved = shifted(seen, 12.0, 2.4, 20)
    np.testing.assert_allclose(moved, (figures(25, 20) + np.array([60.0, 0.0, 0.0]))[:, 0], atol=1e-9)


@pytest.mark.parametrize(
    ("fps", "expected"),
    [
        ({"cam1": 30}, "fps: expected that of cam2 as well, got cam1 30"),
        ({"cam1": 0, "cam2": 60}, "fps[cam1]: expected a positive number, got 0"),
        ({"left": 30, "cam2": 60}, "fps: "),
        (0, "fps: expected a positive number, got 0"),
    ],
)
def test_rates_that_are_none_are_refused(tmp_path, fps, expected):
    write(tmp_path / "pose", {name: figures(25, 5) for name in ("cam1", "cam2")})
    with pytest.raises(sk.InvalidInputError) as raised:
        read_detections(tmp_path / "pose", ["cam1", "cam2"], fps=fps, **LAYOUT)
    assert str(raised.value).startswith(expected)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("cam1=30,cam2", "--fps: expected A=B, each A once, got 'cam2'"),
        ("cam1=30,cam1=60", "--fps: expected A=B, each A once, got 'cam1=60'"),
        ("cam1=fast", "--fps: expected rates, like cam1=30,cam2=59.94, got 'cam1=fast'"),
        ("cam1=30", "--fps: expected that of cam2, cam3, cam4 as well, got cam1 30"),
    ],
)
def test_texts_that_are_no_rates_are_refused(room, tmp_path, text, expected):
    command = ["refine", room / "Calib.toml", room / "even", *READ, "-o", tmp_path / "out"]
    assert_fails(invoke(*command, "--fps", text), 2, expected)


@pytest.mark.parametrize(
    ("views", "fps", "expected"),
    [
        ([], [], "fps: expected one of each camera, 0, got 0"),
        ([figures(25, 5)] * 2, [25], "fps: expected one of each camera, 2, got 1"),
        ([figures(25, 5)] * 2, [25, 0], "fps[1]: expected a positive number, got 0"),
        ([figures(25, 5), figures(25, 5)[..., :2]], [25, 30], "detections[1]: expected shape (T, …"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(views, fps, expected):
    with pytest.raises(sk.InvalidInputError) as raised:
        sk.retimed(views, fps)
    assert str(raised.value).startswith(expected)
