"""Data sets with ground truth, read into one model."""

from __future__ import annotations

from skelsplat.datasets._model import Dataset, Take

__all__ = ["Dataset", "Take"]
