"""The paper's ablations on real or simulated data, with the paper's figures next to ours.

Every setting of an ablation is measured on the same poses with the same detections and starts, so that
differences between settings are paired.

>>> from skelsplat.evaluation import ablations
>>> print(ablations.get("noise").run(ablations.Source(poses=50)).markdown())               # doctest: +SKIP
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import skelsplat as sk
from skelsplat import synthetic
from skelsplat.evaluation.ablations import _other as other
from skelsplat.evaluation.ablations._source import ANNEALED, PAPER, Sample, Source
from skelsplat.evaluation.ablations._sweep import Ablation, Line, Sweep, Trial
from skelsplat.exceptions import one_of

__all__ = ["Source", "get", "names"]

ENCODING = Sweep(
    label="tab:abl-encoding",
    title="Joint encoding, MPJPE",
    corner="encoding",
    values={"rgb": "3 channels", "single": "1 channel", "one_hot": "One-hot"},
    lines=(Line(PAPER, lambda encoding: {"encoding": encoding}),),
    notes=("The closed form exists for the one-hot encoding only.",),
)

ACCUMULATION = Sweep(
    label="tab:abl-accumulation",
    title="Views per step, MPJPE",
    steps="Views per step, steps taken",
    corner="views per step",
    values={1: "1 view", 2: "2 views", 4: "4 views"},
    up_to_views=True,
    lines=(
        Line(PAPER, lambda views: {"views_per_step": views}),
        Line(f"{PAPER}, no early stopping", lambda views: {"views_per_step": views, "stop_tolerance": 0.0}),
    ),
    notes=(f"The {ANNEALED} method always uses all views at once.",),
)


def _first_views(_: Source, sample: Sample, count: int) -> Trial:
    """Take the first cameras of every rig, the only ones to estimate poses."""
    seen = replace(sample, groups=tuple(group.with_views(range(count)) for group in sample.groups))
    return seen, seen.starts("dlt")


VIEWS = Sweep(
    label="tab:abl-views",
    title="Number of views, MPJPE",
    corner="views",
    values={count: f"{count} views" for count in (4, 5, 6, 7, 8)},
    up_to_views=True,
    kinds=("dome",),
    trial=_first_views,
    lines=(Line("DLT"), Line(PAPER, lambda _: {}), Line(ANNEALED, lambda _: {}, ANNEALED)),
    notes=("Cameras are added in the data set's order.",),
)


def _perturbed(source: Source, sample: Sample, level: int) -> Trial:
    """Start by DLT plus the same draw at every level, scaled."""
    return sample, [
        synthetic.perturb(start, level / group.rig.mm_per_unit, seed=source.seed + 1 + k)
        for k, (group, start) in enumerate(zip(sample.groups, sample.starts("dlt"), strict=True))
    ]


NOISE = Sweep(
    label="tab:abl-noise",
    title="Noise on the start, MPJPE",
    corner="σ per axis, mm",
    values={level: f"{level}" for level in (0, 10, 20, 40, 60, 80, 100, 200, 400)},
    trial=_perturbed,
    lines=(
        Line("the start"),
        Line(PAPER, lambda level: {} if level <= 100 else None),
        Line(ANNEALED, lambda _: {}, ANNEALED),
    ),
    notes=("Start by DLT without weights, plus the noise.",),
)

SYMMETRY = Sweep(
    label="tab:abl-symmetry",
    title="Symmetry tier, MPJPE",
    corner="tier",
    values=dict(enumerate(other.TIERS)),
    kinds=("plain", "occ-2", "occ-3"),
    lines=(
        Line(PAPER, lambda tier: {"symmetry_tier": tier}),
        Line(ANNEALED, lambda tier: {"symmetry_tier": tier}, ANNEALED),
    ),
    notes=(f"On occluded data the {PAPER} method has the covariance factor 1.25, as in the paper.",),
    more=other.time_of_tiers,
)

RESOLUTION = Sweep(
    label="tab:abl-resolution",
    title="Resolution of the renderings, MPJPE",
    corner="resolution",
    values={percent: f"{percent} %" for percent in (100, 75, 50, 25)},
    lines=(Line(PAPER, lambda percent: {"resolution": percent / 100}),),
    notes=(
        "Cameras and detections are scaled; the detections keep their sub-pixel places. "
        f"The {ANNEALED} method has no resolution: it renders no pixels.",
    ),
)


def _sigma_mm(factor: float) -> float:
    return math.exp(factor * math.log(sk.RefineConfig.paper().sigma_mm))


def _paper_factor(factor: float) -> dict[str, Any]:
    """Return the settings; splats of the largest factor cover too many pixels to render."""
    return {"occlusion_factor": factor, "renderer": "closed_form" if factor >= 2.0 else "raster"}


COVARIANCE = Sweep(
    label="tab:abl-covariance",
    title="Covariance factor, MPJPE",
    corner="factor (σ)",
    values={factor: f"{factor:g} ({_sigma_mm(factor):.0f} mm)" for factor in (1.0, 1.25, 1.5, 2.0)},
    kinds=("occ-2", "occ-3"),
    lines=(
        Line(PAPER, _paper_factor),
        Line(ANNEALED, lambda factor: {"occlusion_sigma_mm": _sigma_mm(factor)}, ANNEALED),
    ),
    notes=(
        "The factor multiplies the logarithm of σ in mm of elbows, wrists and ankles. "
        f"The {ANNEALED} method gets the same σ in mm for these joints.",
        "At 2 the loss is integrated in closed form, which takes no pixels.",
    ),
)

_ALL = (
    Ablation("encoding", "Joint encoding", (ENCODING.label,), 120, ENCODING),
    Ablation("accumulation", "Views whose gradients add up", (ACCUMULATION.label,), 300, ACCUMULATION),
    Ablation("views", "Number of views", (VIEWS.label,), 72, VIEWS),
    Ablation("initialisation", "Start, by detections", (other.INITIALISATION,), 300, other.initialisation),
    Ablation("noise", "Noise on the start", (NOISE.label,), 300, NOISE),
    Ablation("symmetry", "Symmetry loss", (SYMMETRY.label, other.SECONDS), 150, SYMMETRY),
    Ablation("resolution", "Resolution of the renderings", (RESOLUTION.label,), 300, RESOLUTION),
    Ablation("covariance", "Covariance of occlusion-prone joints", (COVARIANCE.label,), 150, COVARIANCE),
    Ablation("coverage", "Coverage of the covariances, per joint", (other.COVERAGE,), 300, other.coverage),
)
_BY_NAME = {ablation.name: ablation for ablation in _ALL}

names: tuple[str, ...] = tuple(_BY_NAME)


def get(name: str) -> Ablation:
    """Return the ablation of that name; raises `InvalidInputError` if there is none."""
    one_of("name", name, names)
    return _BY_NAME[name]
