"""Speed, compared with its targets: of the paper's settings, and of imports.

python benchmarks/speed.py paper
python benchmarks/speed.py imports [--repeat 9]
"""

from __future__ import annotations

import statistics
import subprocess
import sys
from collections.abc import Callable
from functools import partial

import lab
import numpy as np
from lab import Table, wanted

import skelsplat as sk
from skelsplat import synthetic
from skelsplat.cameras import altered

# Of the paper's settings: calls of which the median counts, and poses of a batch.
_CALLS = 15
_BATCH = 16
_IMPORT_LIMIT_MS = 150.0
_MOST_MODULES = 5


def paper() -> Table:
    """Time the paper's settings, 17 joints, 4 views, all 125 steps; memory is of one refinement.

    Times are the median of repeated calls of ``skelsplat.refine`` from Python, everything included; memory is
    the increase of the peak resident size, measured in a fresh process.
    """
    usual = sk.RefineConfig.paper().stop_tolerance
    batch, name = partial(refined, 1000, _BATCH), f"batch of {_BATCH}"

    def ms(call: Callable[[], object], per: int = 1) -> str:
        times = [lab.seconds(call) for _ in range(1 + _CALLS)][1:]
        return f"{1e3 * statistics.median(times) / per:.1f} ms"

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
    base = _own_ms("import numpy, cv2")
    runs = [_own_ms("import numpy, cv2\nimport skelsplat") for _ in range(repeat + 1)][1:]
    runs = [{name: taken for name, taken in run.items() if name not in base} for run in runs]
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
        lab.main(__doc__, paper, imports)
