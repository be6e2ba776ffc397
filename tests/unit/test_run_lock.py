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
from skelsplat.io import read_run
from skelsplat.run import PeopleRun, Run
from skelsplat.run import folder as folders
from skelsplat.run.frame_range import FrameRange
from skelsplat.run.overlay import Scene
from sweeps import swept

# writes a run into the folder that a line names, for as long as lines come
WRITE = """
import sys
import skelsplat.run.folder as folders
from skelsplat import DatasetError
from skelsplat.run import Run
folders.can_draw = lambda: False
run = Run.open(sys.argv[1])
print("ready", flush=True)
for line in sys.stdin:
    try:
        run.write(line.strip())
    except DatasetError as error:
        print(error, flush=True)
    else:
        print("written", flush=True)
"""
HOLD = """
import sys
from pathlib import Path
from command_line import assert_fails, invoke
from skelsplat._lock import locked
with locked(Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.readline()
"""


def started(program, argument):
    """Start a process, and wait for its first line."""
    process = subprocess.Popen(
        [sys.executable, "-c", program, str(argument)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)},
    )
    assert process.stdout.readline() in ("ready\n", "held\n")
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


def which(folder):
    """Return which of the runs a folder holds as a whole; an error if it is a mixture."""
    read = read_run(folder)
    assert not list(folder.glob(".*"))
    return read.report["note"], float(read.poses.pose[0, 0, 0])


@pytest.mark.parametrize("rounds", [4, swept(300)])
def test_of_two_processes_one_writes_and_the_other_is_refused_or_comes_later(runs, tmp_path, rounds):
    writers = [started(WRITE, folder) for folder, _ in runs.values()]
    whole = {which(folder) for folder, _ in runs.values()}
    for k in range(rounds):
        out = tmp_path / f"out{k % 3}"
        for writer in writers:
            print(out, file=writer.stdin, flush=True)
        said = [writer.stdout.readline() for writer in writers]
        assert "written\n" in said
        pids = {f"process {writer.pid} on " for writer in writers}
        for text in set(said) - {"written\n"}:
            assert (
                f"{out}: output: expected a folder into which no other run writes, got one in use by" in text
            )
            assert "another process" in text or any(pid in text for pid in pids)
        assert which(out) in whole
    for writer in writers:
        writer.communicate()


def test_the_lock_of_a_process_that_was_killed_holds_nothing(tmp_path):
    process = started(HOLD, tmp_path)
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
