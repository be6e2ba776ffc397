"""Data sets with ground truth, read into one model."""

from __future__ import annotations

from skelsplat.datasets._files import Survey
from skelsplat.datasets._model import Dataset, PeopleTake, Take
from skelsplat.datasets._registry import Report, check, names, read
from skelsplat.datasets._verify import verify

__all__ = ["Dataset", "PeopleTake", "Report", "Survey", "Take", "check", "names", "read", "verify"]
