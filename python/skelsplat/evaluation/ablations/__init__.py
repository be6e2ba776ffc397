"""The paper's ablations: one file each, on real or simulated data, with the paper's figures beside ours.

Every setting of an ablation is measured on the same poses with the same detections and starts, so that
differences between settings are paired.
"""

from skelsplat.evaluation.ablations._model import Ablation, Finding, Outcome, Progress, Row, Table
from skelsplat.evaluation.ablations._registry import get, names
from skelsplat.evaluation.ablations._simulated import Simulated
from skelsplat.evaluation.ablations._source import Choices, Source

__all__ = [
    "Ablation",
    "Choices",
    "Finding",
    "Outcome",
    "Progress",
    "Row",
    "Simulated",
    "Source",
    "Table",
    "get",
    "names",
]
