"""Data sets with ground truth, read into one model."""

from __future__ import annotations

from skelsplat.datasets._check import Report, check
from skelsplat.datasets._finding import Finding
from skelsplat.datasets._model import Dataset, Take
from skelsplat.datasets._registry import names, read
from skelsplat.datasets._verify import verify

__all__ = ["Dataset", "Finding", "Report", "Take", "check", "names", "read", "verify"]
