"""Keeps the linear algebra of NumPy, SciPy and OpenCV on one core. Import it before them."""

from __future__ import annotations

import os
import sys

if "numpy" in sys.modules:
    raise ImportError("_one_core: expected to be imported before numpy, which reads these variables once")

os.environ.update(
    dict.fromkeys(
        (
            "OMP_NUM_THREADS",
            "OPENBLAS_NUM_THREADS",
            "MKL_NUM_THREADS",
            "NUMEXPR_NUM_THREADS",
            "NUMBA_NUM_THREADS",
        ),
        "1",
    )
)
