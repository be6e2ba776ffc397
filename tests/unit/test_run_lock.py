"""Two runs into one folder: the second is refused, and the files of two runs are not read as one."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from dataclasses import replace

import pytest

import skelsplat as sk
from skelsplat._lock import locked
from skelsplat.run import PeopleRun, Run
from skelsplat.run import folder as folders
from skelsplat.run.frame_range import FrameRange
from skelsplat.run.overlay import Scene

HOLD = """
import sys
from pathlib import Path
from skelsplat._lock import locked
with locked(Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.readline()
"""


def holding(folder):
    """Start a process that holds the lock of a folder, and wait until it does."""
    process = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(folder)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)},
    )
    assert process.stdout.readline() == "held\n"
    return process


@pytest.fixture
def runs(finished_run, tmp_path, monkeypatch):
    """Two runs of the same frames and joints, with a layout of their own: (folder, run) each."""
    monkeypatch.setattr(folders, "can_draw", lambda: False)
    first = Run.open(finished_run)
    layout = sk.layouts.from_names("own", first.layout.joints, first.layout.limbs)
    first = replace(first, inputs=replace(first.inputs, layout=layout), report={**first.report, "note": "A"})
    moved = replace(first.poses, pose=first.poses.pose + 1)
    found = {"A": first, "B": replace(first, poses=moved, report={**first.report, "note": "B"})}
    for name, run in found.items():
        run.write(tmp_path / name)
    return {name: (tmp_path / name, run) for name, run in found.items()}


def test_the_lock_of_a_process_that_was_killed_holds_nothing(tmp_path):
    process = holding(tmp_path)
    held = rf"in use by process {process.pid} on .* since 20\d\d-"
    with pytest.raises(sk.DatasetError, match=held), locked(tmp_path):
        pass
    process.kill()
    process.communicate()
    assert [path.name for path in tmp_path.iterdir()] == [".skelsplat.lock"]
    with locked(tmp_path):
        assert f"process {os.getpid()} on" in (tmp_path / ".skelsplat.lock").read_text()
    assert not list(tmp_path.iterdir())


def test_a_run_that_is_refused_leaves_the_folder_as_it_is(runs, tmp_path):
    folder, run = runs["A"]
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    parts = folder / ".skelsplat-long-x"  # of the run that writes, or of one that was killed
    parts.mkdir()
    with (
        locked(folder),
        pytest.raises(sk.DatasetError, match="output: expected a folder into which no other"),
    ):
        run.write(folder)
    assert {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()} == before
    run.write(folder)  # removes what a killed one left
    assert not list(folder.glob(".*"))
    run.write(tmp_path / "again")  # the same run is the same bytes
    assert {path.name: path.read_bytes() for path in (tmp_path / "again").iterdir()} == before


def test_two_people_of_one_run_are_not_mixed(runs, tmp_path):
    (_, one), (_, two) = runs.values()
    people = [{"id": k, "folder": f"person_{k}"} for k in (0, 1)]
    report = {"versions": one.report["versions"], "settings": {}, "findings": [], "people": people}
    report["folders"] = [entry["folder"] for entry in people]
    PeopleRun({0: one, 1: two}, (), report).write(tmp_path, html=False)
    PeopleRun.open(tmp_path)
    mixed = tmp_path / "person_1" / "report.json"
    shutil.rmtree(mixed.parent)
    shutil.copytree(tmp_path / "person_0", mixed.parent)
    expected = rf"1/{mixed.name}: run: expected \w{{16}}_person_1, as in .*, got \w{{16}}_person_0: "
    for read in (PeopleRun.open, lambda folder: Scene.read(folder, FrameRange())):
        with pytest.raises(sk.DatasetError, match=expected):
            read(tmp_path)
