"""What `import skelsplat` adds to `import numpy, cv2`, in fresh interpreters.

    python benchmarks/imports.py [--repeat 9] [--markdown]

Measured with `-X importtime`, as the sum of the self times of all modules. The figure is the median over
several interpreters, after one that fills the file cache.
"""

from __future__ import annotations

import statistics
import subprocess
import sys

import lab
from lab import Table
from speed import wanted

LIMIT_MS = 150.0
_BASE, _PACKAGE = "import numpy, cv2", "import skelsplat"
_MOST = 5


def own_times_ms(program: str) -> dict[str, float]:
    """Return the self time of each module, in ms, in a fresh interpreter."""
    command = [sys.executable, "-X", "importtime", "-c", program]
    said = subprocess.run(command, check=True, capture_output=True, text=True).stderr
    times = {}
    for line in said.splitlines():
        taken, _, rest = line.removeprefix("import time:").partition("|")
        if taken.strip().isdigit():  # not the heading
            times[rest.partition("|")[2].strip()] = int(taken) / 1000.0
    return times


def added_ms() -> dict[str, float]:
    """Return the time added by the package in one interpreter, in ms, by module."""
    base = own_times_ms(_BASE)
    both = own_times_ms(f"{_BASE}\n{_PACKAGE}")
    return {name: taken for name, taken in both.items() if name not in base}


def imports(*, repeat: int = 9) -> Table:
    """Measure so many interpreters of each kind."""
    added_ms()
    runs = [added_ms() for _ in range(max(1, repeat))]
    totals = [sum(run.values()) for run in runs]
    modules = {name: statistics.median(run.get(name, 0.0) for run in runs) for name in runs[0]}
    slowest = sorted(modules, key=lambda name: -modules[name])[:_MOST]
    rows = {
        "import skelsplat, after NumPy and OpenCV, median": (
            f"{statistics.median(totals):.1f}",
            f"≤ {LIMIT_MS:g}",
        ),
        "the same, fastest and slowest": (f"{min(totals):.1f} to {max(totals):.1f}", ""),
        **{f"of it {name}": (f"{modules[name]:.1f}", "") for name in slowest},
    }
    return wanted(f"Time of imports in ms, {len(runs)} interpreters", rows)


if __name__ == "__main__":
    lab.main(__doc__, imports)
