"""Speed, compared with its targets: of the default settings, of the paper's, and of imports.

python benchmarks/speed.py default [--batch 1000] [--repeat 5] [--markdown]
python benchmarks/speed.py paper
python benchmarks/speed.py imports [--repeat 9]
"""

from __future__ import annotations

import statistics
import subprocess
import sys
from collections.abc import Callable, Iterable
from functools import partial

import lab
import numpy as np
from lab import ONE_THREAD, Table
from scenarios import NOISES, Scene, simulated

import skelsplat as sk
from skelsplat import synthetic
from skelsplat.cameras import altered

# Share of the batch used for the dome, which has up to 31 views.
_DOME_SHARE = 5
_SINGLE_POSES = 300
# Warm-up calls: the first ones allocate.
_WARM_UP = 10
# Of the paper's settings: calls of which the median counts, and poses of a batch.
_CALLS = 15
_BATCH = 16
_IMPORT_LIMIT_MS = 150.0
_MOST_MODULES = 5


def wanted(title: str, rows: dict[str, tuple[str, str]]) -> Table:
    """Return the table of figures and their targets."""
    heads = ("measured", "wanted")
    return Table.of(title, "what", {name: dict(zip(heads, row, strict=True)) for name, row in rows.items()})


def median_s(call: Callable[[object], object], items: Iterable[object]) -> float:
    """Return the median time of a call over the items after the first few, s."""
    times = [lab.seconds(lambda item=item: call(item), 1) for item in items]
    return statistics.median(times[_WARM_UP:] or times)


def default(*, batch: int = 1000, repeat: int = 5) -> Table:
    """Time batches of so many poses, best of repeated runs, and single poses, median of many calls.

    Simulated detections `good` of six motions, 17 joints, triangulation included.
    """

    def batch_s(scene: Scene, threads: int) -> float:
        given = {"layout": "h36m17", "config": sk.RefineConfig(n_threads=threads)}
        return lab.seconds(partial(sk.refine, None, scene.detections, scene.rig, **given), repeat)

    room, poses = simulated(batch), -(-batch // _DOME_SHARE)
    one, two = (batch_s(room, threads) for threads in (1, 2))
    four, many = (batch_s(simulated(poses, cameras=synthetic.dome(views)), 1) for views in (4, 31))
    walk = synthetic.motion("walk", min(batch, _SINGLE_POSES), seed=0)
    frames = synthetic.simulate_detections(walk, room.rig, noise=NOISES["good"], seed=0)
    given = {"layout": "h36m17", "config": ONE_THREAD}
    single = median_s(lambda seen: sk.refine(None, seen, room.rig, **given), frames)
    step, live = (median_s(sk.Refiner(room.rig, fps=fps, **given).step, frames) for fps in (None, 30))
    rows = {
        f"batch of {batch}, 4 views, 1 core, per pose": (f"{1e6 * one / batch:.1f} µs", "≤ 50 µs"),
        "the same on 2 cores, times the throughput": (f"{one / two:.2f}", "≥ 1.8"),
        "31 views of a dome, times the time of 4": (f"{many / four:.2f}", "≤ 9"),
        "one pose, sk.refine from Python": (f"{1e6 * single:.0f} µs", "≤ 150 µs"),
        "next frame, sk.Refiner.step from Python": (f"{1e6 * step:.0f} µs", "≤ 80 µs"),
        "the same with fps: the past predicts": (f"{1e6 * live:.0f} µs", "≤ 120 µs"),
    }
    return wanted("Default settings, 17 joints, simulated detections 'good'", rows)


def paper() -> Table:
    """Time the paper's settings, 17 joints, 4 views, all 125 steps; memory is of one refinement.

    Times are the median of repeated calls of ``skelsplat.refine`` from Python, everything included; memory is
    the increase of the peak resident size, measured in a fresh process.
    """
    usual = sk.RefineConfig.paper().stop_tolerance
    batch, name = partial(refined, 1000, _BATCH), f"batch of {_BATCH}"

    def ms(call: Callable[[], object], per: int = 1) -> str:
        call()
        return f"{1e3 * median_s(lambda _: call(), range(_CALLS)) / per:.1f} ms"

    rows = {
        "one pose, 1000 × 1000 px, 125 steps, 1 core": (ms(refined(1000, 1)), "≤ 30 ms"),
        "one pose, 4000 × 4000 px, 125 steps, 1 core": (ms(refined(4000, 1)), "as 1000 px"),
        f"{name}, 125 steps, 1 core, per pose": (ms(batch(), _BATCH), ""),
        f"{name}, 125 steps, 2 cores, per pose": (ms(batch(n_threads=2), _BATCH), ""),
        f"{name}, early stopping, 1 core, per pose": (ms(batch(stop_tolerance=usual), _BATCH), ""),
        "closed form, 125 steps, per pose": (ms(batch(renderer="closed_form"), _BATCH), ""),
    }
    command = [sys.executable, __file__, "--memory"]
    grown = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    rows["peak memory of one refinement"] = (f"{float(grown):.1f} MiB", "< 20 MB")
    return wanted("RefineConfig.paper(): 17 joints, 4 views (the paper reports about 3 s on a GPU)", rows)


def refined(size: int, frames: int, **fields: object) -> partial[sk.Refinement]:
    """Return the refinement of images of so many pixels as a call, without early stopping unless given."""
    cameras = []
    for camera in synthetic.human36m_like():
        K = camera.K
        K[:2, 2] = (size - 1) / 2
        cameras.append(altered(camera, K=K, size=(size, size)))
    rig, pose = sk.CameraRig(cameras), synthetic.motion("walk", frames, seed=0)
    detections = sk.project(pose, rig).swapaxes(0, 1)
    detections = detections + np.random.default_rng(0).normal(0, 3.0, detections.shape)
    start = synthetic.perturb(pose, 20.0, seed=1)
    config = sk.RefineConfig.paper(**{"stop_tolerance": 0.0, "n_threads": 1, **fields})
    if frames == 1:
        start, detections = start[0], detections[0]
    return partial(sk.refine, start, detections, rig, layout="h36m17", config=config)


def grown_mib() -> float:
    """Return the increase of the peak during one refinement, in MiB."""
    refined(1000, 2, max_steps=0)()
    before = lab.peak_mib()
    refined(1000, 1)()
    return lab.peak_mib() - before


def imports(*, repeat: int = 9) -> Table:
    """Time what `import skelsplat` adds to `import numpy, cv2`, in so many fresh interpreters.

    Measured with `-X importtime`, as the sum of the self times of all modules, after a first interpreter that
    fills the file cache.
    """
    runs = [_added_ms() for _ in range(repeat + 1)][1:]
    totals = [sum(run.values()) for run in runs]
    modules = {name: statistics.median(run.get(name, 0.0) for run in runs) for name in runs[0]}
    slowest = sorted(modules, key=lambda name: -modules[name])[:_MOST_MODULES]
    median = f"{statistics.median(totals):.1f}"
    rows = {
        "import skelsplat, after NumPy and OpenCV, median": (median, f"≤ {_IMPORT_LIMIT_MS:g}"),
        "the same, fastest and slowest": (f"{min(totals):.1f} to {max(totals):.1f}", ""),
        **{f"of it {name}": (f"{modules[name]:.1f}", "") for name in slowest},
    }
    return wanted(f"Time of imports in ms, {len(runs)} interpreters", rows)


def _added_ms() -> dict[str, float]:
    """Return the time added by the package in one interpreter, in ms, by module."""
    base, both = (_own_ms(f"import numpy, cv2{more}") for more in ("", "\nimport skelsplat"))
    return {name: taken for name, taken in both.items() if name not in base}


def _own_ms(program: str) -> dict[str, float]:
    """Return the self time of each module, in ms, in a fresh interpreter."""
    command = [sys.executable, "-X", "importtime", "-c", program]
    said = subprocess.run(command, check=True, capture_output=True, text=True).stderr
    lines = [line.removeprefix("import time:").split("|") for line in said.splitlines()]
    return {line[-1].strip(): int(line[0]) / 1000.0 for line in lines if line[0].strip().isdigit()}


if __name__ == "__main__":
    if "--memory" in sys.argv:
        print(grown_mib())
    else:
        lab.main(__doc__, default, paper, imports)
