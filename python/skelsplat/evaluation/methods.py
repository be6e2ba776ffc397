"""Methods by name: a take in, poses (T, N, 3) in the rig's unit out, and the settings that they depend on.

>>> from skelsplat.evaluation import methods
>>> methods.get("dlt").settings(methods.Options())
{'undistort': True}

Those that need a trained network are not here: their published figures are in
`skelsplat.evaluation.reported`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from skelsplat._refine import Progress, refine
from skelsplat._skelsplat import Layout, RefineConfig, fuse_monocular, triangulate
from skelsplat.datasets import Take
from skelsplat.evaluation import baselines
from skelsplat.evaluation._method import (
    DEFAULT_INIT_SIGMA_MM,
    STARTS,
    FloatArray,
    Method,
    Options,
    Settings,
    Solution,
)
from skelsplat.exceptions import InvalidInputError

__all__ = [
    "DEFAULT_INIT_SIGMA_MM",
    "STARTS",
    "Method",
    "Options",
    "Solution",
    "get",
    "names",
]

# Side of the crops in whose pixels the thresholds of Iskakov et al. are.
_CROP_PX = 384.0


def crop_scale(take: Take) -> FloatArray:
    """Pixels of the image per pixel of a 384 px crop of the person's square box, (T, M); 1 without a box."""
    if take.boxes is None:
        return np.ones((len(take), len(take.rig)))
    sides = (take.boxes[..., 2:] - take.boxes[..., :2]).max(axis=-1)
    known = np.isfinite(sides) & (sides > 0)
    return np.where(known, sides / _CROP_PX, 1.0)


def _dlt(take: Take, _: Layout, settings: Settings, progress: Progress | None) -> FloatArray:
    del progress
    return baselines.dlt(_detections(take), take.rig, confidence=settings.get("confidence", False))


def _iskakov(take: Take, _: Layout, settings: Settings, progress: Progress | None) -> FloatArray:
    del progress
    return baselines.ransac_iskakov(
        _detections(take), take.rig, crop_scale=crop_scale(take), seed=settings["seed"]
    )


def _adafuse(take: Take, _: Layout, settings: Settings, progress: Progress | None) -> FloatArray:
    del progress
    return baselines.ransac_adafuse(_detections(take), take.rig, seed=settings["seed"])


def _ransac(take: Take, _: Layout, settings: Settings, progress: Progress | None) -> FloatArray:
    del settings, progress
    return triangulate(_detections(take), take.rig, method="ransac")


def _cauchy(take: Take, _: Layout, settings: Settings, progress: Progress | None) -> FloatArray:
    del settings, progress
    return baselines.cauchy(_detections(take), take.rig)


def _fusion(take: Take, _: Layout, settings: Settings, progress: Progress | None) -> FloatArray:
    del settings, progress
    return _fused(take)


def _refine(take: Take, layout: Layout, settings: Settings, progress: Progress | None) -> FloatArray:
    """Start as the settings say, and refine with their configuration."""
    sigma_mm = settings.get("init_sigma_mm")
    return refine(
        _start(take, settings["start"]),
        _detections(take),
        take.rig,
        layout=layout,
        init_sigma=None if sigma_mm is None else sigma_mm / take.rig.mm_per_unit,
        config=RefineConfig(**settings["config"]),
        progress=progress if progress is not None else False,
    ).pose


def _start(take: Take, start: str) -> FloatArray | None:
    if start == "dlt":  # the paper's: without confidences
        return triangulate(_detections(take)[..., :2], take.rig, method="dlt")
    return _fused(take) if start == "fusion" else None


def _fused(take: Take) -> FloatArray:
    assert take.monocular is not None  # Method.check has seen to it
    return fuse_monocular(take.monocular, _detections(take), take.rig)


def _detections(take: Take) -> FloatArray:
    assert take.detections is not None  # likewise
    return take.detections


def _plain(options: Options) -> dict[str, Any]:
    return {"undistort": options.undistort}


def _weighted(options: Options) -> dict[str, Any]:
    return {**_plain(options), "confidence": True}


def _drawn(options: Options) -> dict[str, Any]:
    return {**_plain(options), "seed": options.seed}


def _solver(options: Options, config: RefineConfig, start: str) -> dict[str, Any]:
    fields = config.replace(n_threads=options.n_threads).to_dict()
    return {**_plain(options), "start": start, "config": fields}


def _default(options: Options) -> dict[str, Any]:
    return _solver(options, RefineConfig(), options.start or "none")


def _prior(options: Options) -> dict[str, Any]:
    return {**_solver(options, RefineConfig(), "fusion"), "init_sigma_mm": options.init_sigma_mm}


def _paper(options: Options) -> dict[str, Any]:
    config = RefineConfig.paper(**options.paper_fields)
    return _solver(options, config, options.start or options.paper_start)


def _closed_form(options: Options) -> dict[str, Any]:
    config = RefineConfig.paper(renderer="closed_form", **options.paper_fields)
    return _solver(options, config, options.start or options.paper_start)


_ALL = (
    Method("dlt", "algebraic triangulation, unweighted", _plain, _dlt),
    Method("dlt-confidence", "algebraic triangulation, rows weighted by confidence", _weighted, _dlt),
    Method("ransac-iskakov", "RANSAC of Iskakov et al., with its Huber refinement", _drawn, _iskakov),
    Method("ransac-adafuse", "RANSAC that AdaFuse is compared with", _drawn, _adafuse),
    Method("ransac", "RANSAC of this package", _plain, _ransac),
    Method("cauchy", "DLT, then the Cauchy loss of the reprojection residuals", _plain, _cauchy),
    Method("fusion", "multi-view fusion of monocular 3D poses", _plain, _fusion, ("detections", "monocular")),
    Method("skelsplat", "default: closed form, annealed Gauss–Newton", _default, _refine),
    Method("skelsplat-prior", "default with the fused monocular poses as a Gaussian prior", _prior, _refine),
    Method("skelsplat-closed-form", "the paper's settings with the closed-form loss", _closed_form, _refine),
    Method("skelsplat-paper", "the paper's settings: raster, Adam", _paper, _refine, by_pixels=True),
)
_BY_NAME = {method.name: method for method in _ALL}

names: tuple[str, ...] = tuple(_BY_NAME)


def get(name: str) -> Method:
    """Return a method of the registry.

    Raises
    ------
    InvalidInputError
        If there is none of that name; the message lists all.
    """
    if name not in _BY_NAME:
        raise InvalidInputError(f"methods: expected names among {', '.join(names)}, got {name!r}")
    return _BY_NAME[name]
