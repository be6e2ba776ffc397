"""Files and folders that are damaged, hostile or written by two processes at once. All is simulated."""

from __future__ import annotations

import multiprocessing
import tempfile
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

import skelsplat as sk
from attacks import attack
from skelsplat import synthetic
from skelsplat.run import Run

_ROUNDS = 100


def _run() -> Run:
    rig = synthetic.human36m_like()
    seen = sk.project(synthetic.motion("walk", 5, seed=3), rig).swapaxes(0, 1)
    return Run.from_arrays(sk.refine(None, seen, rig, layout="h36m17"), rig, seen, "h36m17")


def _write(run: Run, orders: Connection) -> None:
    import skelsplat.run.folder as folders

    folders.can_draw = lambda: False  # no pictures, which take long
    while (folder := orders.recv()) is not None:
        try:
            run.write(folder)
        except sk.SkelSplatError as error:
            orders.send("refused" if "in use by" in str(error) else "error")
        except OSError as error:
            orders.send(type(error).__name__)
        else:
            orders.send("")


@attack("12a", f"two processes write runs into one folder, {_ROUNDS} times", "one is refused, no mixtures")
def two_runs_into_one_folder() -> str:
    first = _run()
    runs = [
        replace(
            first,
            report={**first.report, "note": note},
            poses=replace(first.poses, pose=first.poses.pose + k),
        )
        for k, note in enumerate("AB")
    ]
    start = {float(run.poses.pose[0, 0, 0]): run.report["note"] for run in runs}
    context = multiprocessing.get_context("spawn")
    pairs = [context.Pipe() for _ in runs]
    children = [
        context.Process(target=_write, args=(r, pair[1])) for r, pair in zip(runs, pairs, strict=True)
    ]
    for child in children:
        child.start()
    count = dict.fromkeys(("read whole", "mixed and read as whole", "unreadable", "refused"), 0)
    with tempfile.TemporaryDirectory() as place:
        for k in range(_ROUNDS):
            out = Path(place, str(k))
            for mine, _ in pairs:
                mine.send(out)
            count["refused"] += [mine.recv() for mine, _ in pairs].count("refused")
            try:
                read = Run.open(out)
            except sk.SkelSplatError:
                count["unreadable"] += 1
                continue
            same = start[float(np.asarray(read.poses.pose)[0, 0, 0])] == read.report["note"]
            count["read whole" if same else "mixed and read as whole"] += 1
    for mine, _ in pairs:
        mine.send(None)
    for child in children:
        child.join()
    return ", ".join(f"{n} {what}" for what, n in count.items())
