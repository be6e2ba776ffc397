"""What `import skelsplat` adds to `import numpy, cv2`, in fresh interpreters.

    python benchmarks/imports.py [--repeat 9] [--markdown]

Measured with `-X importtime`, as the sum of the self times of all modules. The figure is the median over
several interpreters, after one that fills the file cache. Exit status 1 if it is above 150 ms.
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys

import common

LIMIT_MS = 150.0
_BASE, _PACKAGE = "import numpy, cv2", "import skelsplat"
_MOST = 5


def own_times_ms(program: str) -> dict[str, float]:
    """Return the self time of each module, in ms, in a fresh interpreter."""
    run = subprocess.run(
        [sys.executable, "-X", "importtime", "-c", program], check=True, capture_output=True, text=True
    )
    times = {}
    for line in run.stderr.splitlines():
        taken, _, rest = line.removeprefix("import time:").partition("|")
        if taken.strip().isdigit():  # not the heading
            times[rest.partition("|")[2].strip()] = int(taken) / 1000.0
    return times


def added_ms() -> tuple[float, dict[str, float]]:
    """Return the time added by the package in one interpreter, in ms, in total and by module."""
    base = own_times_ms(_BASE)
    both = own_times_ms(f"{_BASE}\n{_PACKAGE}")
    added = {name: taken for name, taken in both.items() if name not in base}
    return sum(added.values()), added


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--repeat", type=int, default=9, help="interpreters of each kind (9)")
    parser.add_argument("--markdown", action="store_true", help="print Markdown")
    options = parser.parse_args()
    added_ms()
    runs = [added_ms() for _ in range(max(1, options.repeat))]
    totals = [total for total, _ in runs]
    median = statistics.median(totals)
    modules = {name: statistics.median(run.get(name, 0.0) for _, run in runs) for name in runs[0][1]}
    slowest = sorted(modules, key=lambda name: -modules[name])[:_MOST]
    rows = [
        ["import skelsplat, after NumPy and OpenCV, median", f"{median:.1f}", f"≤ {LIMIT_MS:g}"],
        ["the same, fastest and slowest", f"{min(totals):.1f} to {max(totals):.1f}", ""],
        *([f"of it {name}", f"{modules[name]:.1f}", ""] for name in slowest),
    ]
    title = f"Time of imports in ms, {len(runs)} interpreters"
    common.show(title, ["what", "measured", "wanted"], rows, markdown=options.markdown)
    print(common.circumstances())
    if median > LIMIT_MS:
        sys.exit(f"the median of {median:.1f} ms is above {LIMIT_MS:g} ms")


if __name__ == "__main__":
    main()
