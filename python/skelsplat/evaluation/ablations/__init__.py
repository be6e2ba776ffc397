"""The paper's ablations on real or simulated data, with the paper's figures next to ours.

Every setting of an ablation is measured on the same poses with the same detections and starts, so that
differences between settings are paired.

>>> from skelsplat.evaluation import ablations
>>> record = ablations.run("noise", ablations.Simulated(ablations.Choices(poses=50)))      # doctest: +SKIP
>>> [(claim.claim, claim.verdict) for claim in record.outcome.claims]                      # doctest: +SKIP
"""

from skelsplat.evaluation.ablations._source import Choices, OnDisk, Simulated, Source
from skelsplat.evaluation.ablations._sweep import Table
from skelsplat.evaluation.ablations._table import get, names
from skelsplat.evaluation.ablations._write import Record, as_dict, cell, run, write

__all__ = [
    "Choices",
    "OnDisk",
    "Record",
    "Simulated",
    "Source",
    "Table",
    "as_dict",
    "cell",
    "get",
    "names",
    "run",
    "write",
]
