"""The ablations of the paper: what is varied, on which poses, and what the paper claims about it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import skelsplat as sk
from skelsplat import synthetic
from skelsplat._arrays import Array
from skelsplat.evaluation.ablations import _other as other
from skelsplat.evaluation.ablations._source import ANNEALED, PAPER, Errors, Sample, Source, difference
from skelsplat.evaluation.ablations._sweep import Ablation, Check, Line, Sweep, Varied
from skelsplat.exceptions import one_of

ENCODING = Sweep(
    label="tab:abl-encoding",
    title="Joint encoding, MPJPE",
    corner="encoding",
    values={"rgb": "3 channels", "single": "1 channel", "one_hot": "One-hot"},
    lines=(Line(PAPER, lambda encoding: {"encoding": encoding}),),
    checks=(
        Check("One-hot beats three channels and one", lambda e: e["one_hot"].beats(e["rgb"], e["single"])),
        # The paper prints tenths of a millimetre; what it calls equal agrees to that.
        Check(
            "Three channels and one give the same",
            lambda e: abs(difference(e["rgb"], e["single"])[0]) <= 0.1,
        ),
    ),
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
    checks=(
        Check("4 views per step beat 2", lambda e: e[4].beats(e[2])),
        Check("2 views per step beat 1", lambda e: e[2].beats(e[1])),
    ),
    notes=(f"The {ANNEALED} method always uses all views at once.",),
)


def _first_views(_: Source, sample: Sample) -> Varied:
    def varied(count: int) -> tuple[Sample, list[Array]]:
        seen = sample.first_views(count)
        return seen, seen.starts("dlt")

    return varied


VIEWS = Sweep(
    label="tab:abl-views",
    title="Number of views, MPJPE",
    corner="views",
    values={count: f"{count} views" for count in (4, 5, 6, 7, 8)},
    up_to_views=True,
    kinds=("dome",),
    begin=_first_views,
    lines=(Line("DLT"), Line(PAPER, lambda _: {}), Line(ANNEALED, lambda _: {}, ANNEALED)),
    checks=(
        Check("All views beat 4", lambda e: e[max(e)].beats(e[4])),
        # tab:abl-views: 6 views err 30 % less than 4; 7 and 8 are within 7 % of 6.
        Check("6 views err at least a fifth less than 4", lambda e: e[6].above(e[4]) <= -0.2),
        Check(
            "Beyond 6 views little changes (at most 10 %)",
            lambda e: all(abs(e[n].above(e[6])) <= 0.1 for n in (7, 8)),
        ),
        Check("The seventh camera, oblique, makes it slightly worse", lambda e: e[6].beats(e[7])),
    ),
    notes=("Cameras are added in the data set's order.",),
)


def _perturbed(source: Source, sample: Sample) -> Varied:
    """Start by DLT plus the same draw at every level, scaled."""
    clean = sample.starts("dlt")

    def varied(level: int) -> tuple[Sample, list[Array]]:
        return sample, [
            synthetic.perturb(start, level / group.rig.mm_per_unit, seed=source.seed + 1 + k)
            for k, (group, start) in enumerate(zip(sample.groups, clean, strict=True))
        ]

    return varied


_LEVELS_MM = (0, 10, 20, 40, 60, 80, 100, 200, 400)


def _most(errors: Mapping[int, Errors], *levels: int) -> float:
    """Return the largest change against no noise."""
    return max(errors[level].above(errors[0]) for level in levels)


NOISE = Sweep(
    label="tab:abl-noise",
    title="Noise on the start, MPJPE",
    corner="σ per axis, mm",
    values={level: f"{level}" for level in _LEVELS_MM},
    begin=_perturbed,
    lines=(
        Line("the start"),
        Line(PAPER, lambda level: {} if level <= 100 else None),
        Line(ANNEALED, lambda _: {}, ANNEALED),
    ),
    checks=(
        # tab:abl-noise, both detectors: up to +8.4 % at 20 mm, +25.1 % at 40 mm; ×2.4 and ×3.0 at 80 mm, ×3.2
        # and ×4.1 at 100 mm.
        Check("Flat to 20 mm (at most +10 %)", lambda e: _most(e, 10, 20) <= 0.1),
        Check("Stable to 40 mm (at most +30 %)", lambda e: _most(e, 10, 20, 40) <= 0.3),
        Check("More than twice by 80 mm", lambda e: _most(e, 80) >= 1.0),
        Check("More than three times by 100 mm", lambda e: _most(e, 100) >= 2.0),
        Check(
            "The result does not depend on the start (within 2 %)",
            lambda e: all(abs(e[level].above(e[0])) <= 0.02 for level in _LEVELS_MM),
            row=ANNEALED,
            ours=True,
        ),
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
    checks=(
        Check("Symm-1 beats none", lambda e: e[1].beats(e[0])),
        # tab:abl-symmetry: beyond Symm-1 the error changes by 3.7 % at most.
        Check("Symm-2 changes little against Symm-1 (4 %)", lambda e: abs(e[2].above(e[1])) <= 0.04),
        Check("Symm-3 changes little against Symm-1 (4 %)", lambda e: abs(e[3].above(e[1])) <= 0.04),
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
    checks=(
        # tab:abl-resolution: +0.5 % at most at 75 %, +2.0 % at 50 %; +3.0 % and +6.9 % at 25 %.
        Check(
            "Resolution costs little down to 50 % (at most 3 %)",
            lambda e: max(e[75].above(e[100]), e[50].above(e[100])) <= 0.03,
        ),
        Check("At 25 % accuracy is lost", lambda e: e[100].beats(e[25])),
    ),
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
    checks=(
        Check("1.25 is better than no factor", lambda e: e[1.25].beats(e[1.0])),
        Check("1.25 is the best of 1.25, 1.5 and 2", lambda e: e[1.25].beats(e[1.5], e[2.0])),
        # tab:abl-covariance: 1.5 costs 4.7 to 7.0 %; 2 multiplies the error by 2.0 to 2.2.
        Check("1.5 costs little (at most 10 %)", lambda e: e[1.5].above(e[1.25]) <= 0.1),
        Check("2 nearly doubles the error (at least +80 %)", lambda e: e[2.0].above(e[1.25]) >= 0.8),
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
