"""Keeps the linear algebra of NumPy, SciPy and OpenCV on one core, if it is imported before them."""

from __future__ import annotations

import os
import sys

_LIBRARIES = ("OMP", "OPENBLAS", "MKL", "NUMEXPR", "NUMBA")

if "numpy" not in sys.modules:
    os.environ.update({f"{name}_NUM_THREADS": "1" for name in _LIBRARIES})
