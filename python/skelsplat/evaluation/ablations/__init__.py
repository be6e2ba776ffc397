"""The paper's ablations on real or simulated data, with the paper's figures next to ours.

Every setting of an ablation is measured on the same poses with the same detections and starts, so that
differences between settings are paired.

>>> from skelsplat.evaluation import ablations
>>> print(ablations.get("noise").run(ablations.Source(poses=50)).markdown())               # doctest: +SKIP
"""

from skelsplat.evaluation.ablations._source import Source
from skelsplat.evaluation.ablations._table import get, names

__all__ = ["Source", "get", "names"]
