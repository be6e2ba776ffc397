"""Recordings of one session: one rig from all of them, and clocks of their own."""

from __future__ import annotations

import json

import numpy as np
import pytest

import calibration_files as files
from command_line import assert_fails, invoke, succeed
from overlay_case import write_video
from rig_case import turned
from skelsplat import synthetic
from skelsplat.io import read_calibration, write_calibration
from skelsplat.io.detections._record import Record, Video, write_record
from skelsplat.run import Job, run_batch
from skelsplat.run.calibrate import calibrate_cameras
from skelsplat.run.cameras import adjust_cameras
from sweeps import swept

LAYOUT = ["--layout", "h36m17"]
RIG = synthetic.human36m_like(distortion=True)
LATE = {"first": 4, "second": -3}  # frames by which the numbers of cam2 are too high


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    """Write two walks, of 40 frames from 10 and from 100 on, in which cam2 has other clocks."""
    top = tmp_path_factory.mktemp("session")
    write_calibration(top / "Calib.toml", RIG)
    write_calibration(top / "old.toml", turned(RIG, 2, [1.0, 1.5, -1.0]))
    for k, (name, late) in enumerate(LATE.items()):
        seen = synthetic.simulate_detections(
            synthetic.motion("walk", 50, seed=k + 1), RIG, noise=synthetic.DetectionNoise.good(), seed=k + 3
        )[..., :2]
        there = seen[5:45].copy()
        there[:, 1] = seen[5 - late : 45 - late, 1]
        files.openpose_folders(top / name, RIG, there)
    return top


def recordings(room):
    return [room / name for name in LATE]


def test_cameras_are_adjusted_by_all_and_clocks_in_each(room, tmp_path):
    alone = adjust_cameras(room / "old.toml", room / "first", layout="h36m17")
    found = adjust_cameras(room / "old.toml", recordings(room), layout="h36m17")
    assert alone.adjusted == found.adjusted == ("cam3",)
    assert found.adjustment.report[2].turn_sigma < alone.adjustment.report[2].turn_sigma
    turn = np.asarray(found.cameras["cam3"].R) @ np.asarray(RIG["cam3"].R).T
    assert np.degrees(np.arccos((np.trace(turn) - 1) / 2)) < 0.2
    assert found.session.offsets == {str(room / name): {"cam2": -late} for name, late in LATE.items()}
    assert (alone.cameras.clocks, found.cameras.clocks) == ({"cam2": 4.0}, {})  # no clock is that of both
    out = tmp_path / "fixed.toml"
    result = succeed("adjust-cameras", room / "old.toml", *recordings(room), "-o", out, *LAYOUT)
    assert result.stdout.splitlines()[-2:] == [
        f"Clocks of {room / 'first'}: --offset cam2=-4",
        f"Clocks of {room / 'second'}: --offset cam2=3",
    ]


def test_recordings_have_the_same_cameras_and_joints(room, tmp_path):
    files.openpose_folders(tmp_path / "three", RIG[:3], np.full((5, 3, 17, 2), 300.0))
    given = ["-o", tmp_path / "new.toml", *LAYOUT, "--size", "1000x1000"]
    result = invoke("calibrate", room / "first", tmp_path / "three", *given)
    assert_fails(result, 1, "three: cameras: expected those of", "first, cam1, cam2, cam3, cam4")
    result = invoke("calibrate", room / "first", room / "first", *given)
    assert_fails(result, 1, "detections: expected every recording once")


def test_copies_in_another_size_are_resized_and_other_images_refused(tmp_path):
    noise = synthetic.DetectionNoise.good()
    seen = synthetic.simulate_detections(synthetic.motion("walk", 80), RIG, noise=noise, seed=3)[..., :2]
    half = seen.copy()
    half[:, 1] = (seen[:, 1] + 0.5) / 2 - 0.5
    whole = {name: camera.size for name, camera in zip(RIG.names, RIG, strict=True)}
    small = {**whole, "cam2": (500, 500)}
    paths = {name: tmp_path / name for name in ("first", "again", "half")}
    for (name, path), sizes in zip(paths.items(), (whole, whole, small), strict=True):
        files.openpose_folders(path, RIG, half if name == "half" else seen)
        videos = {name: Video("a.mp4", size, None) for name, size in sizes.items()}
        write_record(path, Record({"backend": "own"}, "h36m17", videos=videos))
    equal, resized = (
        calibrate_cameras([paths["first"], paths[name]], layout="h36m17", same_focal=True)
        for name in ("again", "half")
    )
    for a, b in zip(equal.found.cameras, resized.found.cameras, strict=True):
        np.testing.assert_allclose(a.K, b.K, rtol=1e-6)
        np.testing.assert_allclose(a.t, b.t, rtol=1e-5)
    kinds = [[one.kind for one in found.findings] for found in (equal, resized)]
    assert kinds == [[], ["image_sizes_differ"]]
    (paths["half"] / "detect.json").unlink()  # refine does not read videos for sizes, and would not resize
    given = ["-o", tmp_path / "new.toml", "--layout", "h36m17"]
    for size in (small["cam2"], (1000, 800)):
        for name in RIG.names:
            write_video(paths["half"] / f"{name}.mp4", 1, size if name == "cam2" else whole[name])
        expected = f"half: image size: expected 1000x1000 for cam2, as in {paths['first']}"
        assert_fails(invoke("calibrate", paths["first"], paths["half"], *given), 1, expected)


@pytest.mark.parametrize("clock", [True, swept(False)])  # some frames are found unasked
def test_a_rig_is_found_from_all_with_their_clocks(room, clock):
    given, steps = {"layout": "h36m17", "fps": 50.0, "stature": 1.7, "clock": clock}, []
    found = calibrate_cameras(
        recordings(room), room / "Calib.toml", progress=lambda *one: steps.append(one), **given
    )
    assert steps == sorted(steps)
    assert steps[-1][0] == steps[-1][1]
    assert [one.frames for one in found.recordings] == [40, 40]
    assert [one.offsets["cam2"] for one in found.recordings] == pytest.approx([-4, 3], abs=0.5)
    assert found.found.clocks == dict.fromkeys(RIG.names, 0.0)
    late = [one.numbers["clock_frames"] for one in found.findings if one.subject.cameras == ("cam2",)]
    assert late == pytest.approx([4, -3], abs=0.5)
    alone = calibrate_cameras(room / "first", room / "Calib.toml", **given)
    bars = [max(one.place_sigma for one in each.found.report) for each in (alone, found)]
    assert bars[1] < bars[0]


def test_a_batch_has_one_rig_and_the_clocks_of_each_recording(room, tmp_path):
    given = {"layout": "h36m17", "unit": "mm", "adjust_cameras": True, "write": (), "html": False}
    jobs = {name: Job(room / "old.toml", room / name, **given) for name in LATE}
    found = run_batch(jobs, tmp_path)
    ((first, second),) = [one.recordings for one in found.sessions]
    assert (first, second) == tuple(LATE)
    used = [read_calibration(tmp_path / name / "cameras.json") for name in LATE]
    for a, b, true in zip(*used, RIG, strict=True):
        np.testing.assert_array_equal(a.R, b.R)
        assert np.linalg.norm(a.R - true.R) < 0.005
    reports = [json.loads((tmp_path / name / "report.json").read_text()) for name in LATE]
    assert [report["input"]["offsets"] for report in reports] == [{"cam2": -4}, {"cam2": 3}]
    document = json.loads((tmp_path / "batch.json").read_text())
    (session,) = document["sessions"]
    assert [one["kind"] for one in session["findings"]].count("frame_offset") == 2
    again = run_batch(jobs, tmp_path)
    assert [one.status for one in again.recordings] == ["unchanged", "unchanged"]
    assert again.sessions == found.sessions
