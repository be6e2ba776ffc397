"""Results on disk: found again if they are whole and belong, computed again if not."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from typer.testing import CliRunner

import takes
from skelsplat import synthetic
from skelsplat.cli import app
from skelsplat.datasets import Dataset
from skelsplat.datasets.synthetic import write_simulated
from skelsplat.evaluation import methods, protocols, runs
from sweeps import swept

DATA = takes.simulated(3)


def solve(folder: Path, data: Dataset = DATA, undistort: bool = True) -> int:
    """Return how often `dlt` ran; its poses are right in any case."""
    plain, options = methods.get("dlt"), methods.Options(undistort=undistort)
    spy = replace(plain, run=Mock(wraps=plain.run))
    cases = protocols.get("human36m").cases(data)
    found = runs.run(cases, data.layout, [spy], options, store=runs.Store(folder, (data.name,)))
    for case, solution in zip(cases, found["dlt"], strict=True):
        expected = plain.solve(case.take, data.layout, plain.settings(options))
        np.testing.assert_array_equal(solution.pose, expected.pose)
    return spy.run.call_count


def files(folder: Path) -> list[Path]:
    return sorted(folder.rglob("*.npz"))


def test_a_second_run_finds_everything(tmp_path: Path) -> None:
    assert solve(tmp_path) == 2
    assert [path.name.rpartition("-")[0] for path in files(tmp_path)] == ["S11-Walking", "S9-Directions-1"]
    assert solve(tmp_path) == 0


@pytest.mark.parametrize("change", ["detections", "cameras", "settings"])
def test_another_case_is_computed_anew(tmp_path: Path, change: str) -> None:
    solve(tmp_path)
    first, second = DATA.takes
    if change == "detections":
        detections = first.detections.copy()
        detections[0, 0, 0, 0] += 1e-9
        first = replace(first, detections=detections)
    elif change == "cameras":
        first = replace(first, rig=synthetic.human36m_like())
    other, undistort = replace(DATA, takes=(first, second)), change != "settings"
    assert solve(tmp_path, other, undistort) == (2 if change == "settings" else 1)
    assert solve(tmp_path, other, undistort) == 0


@pytest.mark.parametrize("count", [60, swept(21_000)])
@pytest.mark.timeout(600)
def test_no_damage_is_read_back(tmp_path: Path, count: int) -> None:
    """Neither ends cut off nor bytes replaced, added and removed, at places drawn at random."""
    solve(tmp_path)
    path, (case, _) = files(tmp_path)[1], protocols.get("human36m").cases(DATA)
    content, data, rng = path.read_bytes(), runs.fingerprint(case.take), np.random.default_rng(7)
    for k, place in enumerate(rng.integers(len(content), size=count)):
        byte = bytes([content[place] ^ int(rng.integers(1, 256))])
        end = (b"", byte + content[place + 1 :], byte + content[place:], content[place + 1 :])[k % 4]
        damaged = content[:place] + end
        path.write_bytes(damaged)
        assert damaged == content or runs.load(path, data) is None
    path.write_bytes(content)
    assert runs.load(path, data) is not None


@pytest.fixture(scope="module")
def small_set(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One pose or so of each of the 60 takes of a simulated Human3.6M."""
    root = tmp_path_factory.mktemp("data") / "set"
    write_simulated(root, synthetic.simulate_set("human36m-like", poses=100))
    return root


METHODS = "dlt,ransac,cauchy,annealed"


def arguments(root: Path, out: Path) -> list[str]:
    return ["evaluate", "synthetic", str(root), "--output", str(out), "-q", "-m", METHODS]


def table(root: Path, out: Path) -> list[str]:
    """Evaluate, and return the lines of the CSV without the times."""
    assert CliRunner().invoke(app, arguments(root, out)).exit_code == 0
    lines = (out / "report.csv").read_text(encoding="utf-8").splitlines()
    return [line.rpartition(",")[0] for line in lines]


@pytest.fixture(scope="module")
def undisturbed(small_set: Path, tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    return table(small_set, tmp_path_factory.mktemp("undisturbed"))


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), swept(signal.SIGKILL, -signal.SIGKILL)])
def test_a_stopped_evaluation_goes_on(
    number: signal.Signals, status: int, small_set: Path, undisturbed: list[str], tmp_path: Path
) -> None:
    command = [sys.executable, "-m", "skelsplat", *arguments(small_set, tmp_path)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        while len(files(tmp_path)) < 30:
            assert process.poll() is None, "it was done before it could be stopped"
            time.sleep(0.005)
        process.send_signal(number)
        assert process.wait() == status
        said = process.stderr.read()
    assert ("interrupted; files already written are complete" in said) == (number == signal.SIGINT)
    assert not (tmp_path / "report.csv").exists()
    before = {path: path.stat().st_mtime_ns for path in files(tmp_path)}
    assert 30 <= len(before) < 240
    assert table(small_set, tmp_path) == undisturbed
    assert all(path.stat().st_mtime_ns == when for path, when in before.items())
    assert len(files(tmp_path)) == 240


def test_over_time_all_frames_are_solved_and_those_that_count_are_kept(tmp_path: Path) -> None:
    data = takes.recording()
    rules = replace(protocols.get("human36m"), every=16)
    (case,) = rules.cases(data)
    assert case.take.frames.tolist() == [0, 16, 32]
    method, options = methods.get("over-time"), methods.Options()
    whole = method.solve(data.takes[0], data.layout, method.settings(options))

    def found(data: Dataset, rules: protocols.Protocol) -> np.ndarray:
        store = runs.Store(tmp_path, ())
        cases = rules.cases(data)
        return runs.run(cases, data.layout, [method], options, store=store)["over-time"][0].pose

    frames = data.takes[0].frames
    np.testing.assert_array_equal(found(data, rules), whole.pose[np.isin(frames, [0, 16, 32])])
    # as many frames, but others; the same frames at another rate
    other = replace(rules, ranges=((5, 35),), every=15)
    np.testing.assert_array_equal(found(data, other), whole.pose[np.isin(frames, [15, 30])])
    assert not np.array_equal(found(data.with_fps(100.0), rules), whole.pose[np.isin(frames, [0, 16, 32])])
