"""Several people seen by cameras of which some are displaced."""

from __future__ import annotations

import warnings

import numpy as np

import skelsplat as sk
from skelsplat import synthetic
from skelsplat.findings import Finding, collected_warnings


def found_with(
    displaced: tuple[int, ...], off_px: float, people: int = 2, seed: int = 0, frames: int = 60
) -> tuple[list[sk.Person], list[Finding]]:
    """Track people whom four cameras see, some of them off by so many pixels; also return the findings."""
    rig = synthetic.ring(4, radius_mm=4500.0)
    scene = synthetic.simulate_scene(people, rig, n_frames=frames, fps=30.0, seed=seed)
    seen = np.array(scene.people)
    seen[:, list(displaced), ..., 0] += off_px
    with warnings.catch_warnings(), collected_warnings() as found:
        return sk.track(seen, rig, fps=30.0, layout=scene.layout), found
