"""Evaluation metrics for 3D poses, and for several tracked people (`track_scores`).

Predicted and true joints, ``pred`` and ``gt``, are ``(…, N, 3)`` with any number of leading axes (frames,
people); lengths are mm. Shapes that differ, and other bad arguments, are an `InvalidInputError` that names
the argument.

Missing values follow one rule:

* A joint whose *ground truth* has a NaN coordinate is excluded from every metric.
* A joint whose *prediction* has a NaN coordinate is missing. Distances (`mpjpe` and its variants) and
  `sigma_coverage` leave it out, so read them together with `missing_rate`; the rates (`pck`, `auc`, `pcp`)
  count it as wrong.
* A mean over nothing is NaN.
* A masked entry is NaN. Coordinates beyond ±1e100, whose products would overflow, are an `InvalidInputError`.

``reduce`` says what is averaged: ``"mean"`` everything at once (each joint of each pose counts the same),
``"per_joint"`` all leading axes, giving ``(N,)``; ``"per_pose"`` the joints, giving ``(…)``; ``"none"``
nothing, giving ``(…, N)`` with NaN at excluded joints. For `pcp` the limbs take the joints' place.
"""

from skelsplat.metrics._joints import (
    auc,
    missing_rate,
    mpjpe,
    pa_mpjpe,
    pck,
    pcp,
    root_relative_mpjpe,
    sigma_coverage,
)
from skelsplat.metrics._people import TrackScores, track_scores

__all__ = [
    "TrackScores",
    "auc",
    "missing_rate",
    "mpjpe",
    "pa_mpjpe",
    "pck",
    "pcp",
    "root_relative_mpjpe",
    "sigma_coverage",
    "track_scores",
]
