"""The paper's ablations: one file each, on real or simulated data, with the paper's figures beside ours.

Every setting of an ablation is measured on the same poses with the same detections and starts, so that
differences between settings are paired.
"""

from skelsplat.evaluation.ablations._model import Ablation, Finding, Outcome, Progress, Row, Table
from skelsplat.evaluation.ablations._real import OnDisk
from skelsplat.evaluation.ablations._registry import get, names
from skelsplat.evaluation.ablations._simulated import Simulated
from skelsplat.evaluation.ablations._source import Choices, Source
from skelsplat.evaluation.ablations._write import Record, as_dict, cell, write

__all__ = [
    "Ablation",
    "Choices",
    "Finding",
    "OnDisk",
    "Outcome",
    "Progress",
    "Record",
    "Row",
    "Simulated",
    "Source",
    "Table",
    "as_dict",
    "cell",
    "get",
    "names",
    "write",
]
