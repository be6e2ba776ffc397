"""A long recording, done in parts, gives the files of one that is done at once."""

from __future__ import annotations

import tracemalloc
import zipfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import skelsplat as sk
from skelsplat import _budget, synthetic
from skelsplat.io import _arrays, read_run, write_calibration
from skelsplat.io.poses._pose_data import ARRAYS
from skelsplat.run import Job, Run, folder, frame_range, frames, parts, read, run, run_people
from skelsplat.run.frame_range import FrameRange
from skelsplat.run.plots import read_source
from skelsplat.run.report import thinned_in_words

FPS, STEPS = 10.0, 1300  # windows of 600 frames


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a recording of more than one window, with gaps, a hidden hand and swaps, as one npz file."""
    folder, rig = tmp_path_factory.mktemp("long"), synthetic.human36m_like()
    there = synthetic.motion("walk", STEPS // 2, seed=0)
    noise = synthetic.DetectionNoise.occluded(3)
    poses = np.concatenate([there, there[::-1]])
    seen = synthetic.simulate_detections(poses, rig, noise=noise, layout="h36m17", seed=0)
    seen[300:340, :, 5] = np.nan
    seen[700:703] = np.nan
    there = np.delete(np.arange(STEPS), slice(900, 930))
    names = np.array(rig.names)
    np.savez(folder / "detections.npz", detections=seen[there], camera_names=names, frames=there)
    write_calibration(folder / "cameras.json", rig)
    return folder


@pytest.fixture(autouse=True, scope="module")
def everything_is_long() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(_arrays, "BIG", 1)
        patch.setattr(folder, "can_draw", lambda: False)
        patch.setattr(read, "LONG", 0)
        patch.setattr(parts, "_PER_PART", 1)
        yield


def job(files: Path, out: Path, **options: object) -> Job:
    given = {"layout": "h36m17", "fps": FPS, "write": ("trc",), "html": False, **options}
    return Job(files / "cameras.json", files / "detections.npz", output=out, **given)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def over_time(files: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Run]:
    """Do the recording in parts, over time; return the folder, not to be written to, and the run."""
    out = tmp_path_factory.mktemp("over-time") / "parts"
    return out, run(job(files, out))


def at_once(job: Job, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Do a job as if its recording were short."""
    with monkeypatch.context() as patch:
        patch.setattr(read, "LONG", 10**9)
        return run(job)


def test_one_of_several_people_is_followed_from_part_to_part(tmp_path: Path) -> None:
    rig = synthetic.ring(4, radius_mm=4500.0)
    scene = synthetic.simulate_scene(3, rig, n_frames=300, fps=10, seed=2)
    write_calibration(tmp_path / "cameras.json", rig)
    np.savez(tmp_path / "detections.npz", detections=scene.people, camera_names=np.array(rig.names))
    given = job(tmp_path, tmp_path, layout=scene.layout)
    opened = read.open_files(given)
    _, followed, without = parts.follow(opened, given, tmp_path, 100)
    found, own = followed.read(0, 300), scene.detections()
    seen = np.isfinite(found[..., 0]).any(axis=-1)
    shares = [(seen & (one == found)[..., 0].any(axis=-1)).sum() / seen.sum() for one in own]
    assert seen.mean() > 0.9
    assert max(shares) > 0.99
    assert not (without.read(0, 300) & seen).any()


@pytest.mark.parametrize("options", [{}, {"frame_by_frame": True}], ids=["over time", "frame by frame"])
def test_files_are_those_of_the_whole(
    files: Path,
    over_time: tuple[Path, Run],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    options: dict[str, object],
) -> None:
    whole = at_once(job(files, tmp_path / "whole", **options), monkeypatch)
    out, found = over_time
    if options:
        out, found = tmp_path / "parts", run(job(files, tmp_path / "parts", **options))
    folders = [out, tmp_path / "whole"]
    trc = [(one / "pose.trc").read_bytes() for one in folders]
    assert trc[0] == trc[1]
    for name in ("pose.npz", "detections.npz"):
        parts, every = (zipfile.ZipFile(one / name) for one in folders)
        with parts, every:
            assert parts.namelist() == every.namelist()
            differ = {key for key in every.namelist() if parts.read(key) != every.read(key)}
        assert differ <= {"bone_length_sigma.npy", "run.npy"}
    assert found.statistics.statuses == whole.statistics.statuses
    assert found.frame_findings == whole.frame_findings
    pairs = zip(found.statistics.joints, whole.statistics.joints, strict=True)
    for group, same in ((found.statistics.total, whole.statistics.total), *pairs):
        assert group["mean_weight"] == pytest.approx(same["mean_weight"], rel=1e-12)  # the order of a sum
        assert {**group, "mean_weight": 0.0} == {**same, "mean_weight": 0.0}
    assert found.report["input"].pop("thinned")["every"] == 1
    assert found.report["input"] == whole.report["input"]
    assert found.findings == whole.findings


def test_counts_are_of_all_frames_and_medians_of_those_drawn(
    files: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = at_once(job(files, tmp_path / "whole", frame_by_frame=True, write=()), monkeypatch)
    monkeypatch.setattr(folder, "can_draw", lambda: True)
    monkeypatch.setattr(parts, "DRAWN", 150)
    monkeypatch.setattr(parts, "MOST_NAMED", 5)
    monkeypatch.setattr(frames, "_MOST", 7)
    found = run(job(files, tmp_path / "parts", frame_by_frame=True, write=()))
    assert found.report["input"]["thinned"]["every"] == 9
    assert found.frames.tolist() == whole.frames[::9].tolist()
    for group, same in zip(found.statistics.cameras, whole.statistics.cameras, strict=True):
        assert (group["used"], group["missing"], group["rejected"]) == (
            same["used"],
            same["missing"],
            same["rejected"],
        )
        assert group["after_px"] == pytest.approx(same["after_px"], rel=0.2)
    pages = [thinned_in_words(found.inputs), thinned_in_words(whole.inputs)]
    assert pages == [[pages[0][0]], []]
    assert "every 9th frame (142)" in pages[0][0]
    weak, same = (next(one for one in of.findings if one.kind == "weak_joints") for of in (found, whole))
    assert weak.numbers["frames_in_all"] == [len(frames) for frames in same.numbers["frames"]]
    assert max(map(len, weak.numbers["frames"])) == 5
    assert weak.text == same.text
    single = [sum(len(finding.subject.frames) for finding in of.frame_findings) for of in (found, whole)]
    assert single[0] == 7
    # what is usual is that of the frames drawn
    assert found.report["frame_findings_left_out"] == pytest.approx(single[1] - 7, abs=3)


def test_memory_hardly_grows_with_the_recording(
    files: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(_arrays, "_PIECE", 2**17)
    monkeypatch.setattr(parts, "_LEAST_FRAMES", 200)
    monkeypatch.setattr(parts, "DRAWN", 100)
    monkeypatch.setattr(parts, "MOST_NAMED", 10)
    monkeypatch.setattr(frames, "_MOST", 10)
    with np.load(files / "detections.npz") as every:
        seen, names = every["detections"][:200], every["camera_names"]
    write_calibration(tmp_path / "cameras.json", synthetic.human36m_like())
    peaks = []
    for times in (2, 4):
        np.savez(tmp_path / "detections.npz", detections=np.tile(seen, (times, 1, 1, 1)), camera_names=names)
        tracemalloc.start()
        run(job(tmp_path, tmp_path / "out", frame_by_frame=True, write=("npz",)))
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] - peaks[0] < 500 * 2 * len(seen)  # bytes per frame; at once it is some 20,000


def test_an_option_that_needs_all_frames_is_refused_where_they_do_not_fit(
    files: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(read, "_AT_ONCE", 10**4)
    monkeypatch.setattr(_budget, "_available", lambda: 10**8)
    with pytest.raises(sk.DatasetError, match=r"npz: people: expected what fits into memory"):
        run_people(job(files, tmp_path / "none", people="all"))
    assert not (tmp_path / "none").exists()


def test_of_a_long_run_a_range_is_read(over_time: tuple[Path, Run], monkeypatch: pytest.MonkeyPatch) -> None:
    out, _ = over_time
    whole = read_run(out)
    range = FrameRange(890, 940)
    few = read_source(out, range=range)
    monkeypatch.setattr(frame_range, "MANY", 40)
    part = read_run(out, within=range.to_read)
    assert part.ends == whole.ends == (0, STEPS - 1)
    assert part.poses.frames.tolist() == [*np.arange(890, 900), *np.arange(930, 941)]
    own = np.isin(whole.poses.frames, part.poses.frames)
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(part.poses, name), getattr(whole.poses, name)[own])
    np.testing.assert_array_equal(part.detections, whole.detections[own])
    again = read_source(out, range=range)
    assert (again.zero, again.title) == (few.zero, few.title)
    with pytest.raises(sk.InvalidInputError, match="range: expected some of the frames 0 to 1299, got 2000"):
        read_source(out, range=FrameRange(2000, 2000))


def test_an_interrupted_run_leaves_nothing(files: Path, tmp_path: Path) -> None:
    def interrupt(done: int, of: int) -> None:
        if 2 * done > of:  # while the second half of the work is done: solving
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(job(files, tmp_path / "out"), progress=interrupt)
    assert not (tmp_path / "out").exists()
