"""Simulated 2D detections: a model of what a keypoint detector does wrong, applied to projected joints.

Nothing here has seen an image. For every view on its own, true projections become detections in this order:

1. *Jitter*: normal, standard deviation `sigma_px` × a factor of the joint (wrists more than shoulders).
2. *Outliers*: with probability `outlier_rate` a joint moves by an exponentially distributed length of mean
   `outlier_px` in a random direction.
3. *Left-right swaps*: of one limb's chain (`limb_swap_rate` per limb and frame) or of everything in the view
   (`view_swap_rate` per frame). The confidence does not know.
4. *Occluders*: in `occluded_views` views discs lie over the body. A joint inside a disc is missing with
   probability `hidden_missing_rate`; else it is detected at a wrong place: uniformly in the disc, or, with
   probability `hidden_drawn_rate`, near another joint.
5. *Misses*: with probability `miss_rate` a joint is not detected. A joint outside the image never is.

Without `memory` every frame is drawn by itself. With it (`skelsplat.synthetic.memory`) all of this lasts, and
rates are shares of the time. A comparison of methods that smooth needs it: white noise flatters them.
Confidence is about 0.9 for a visible joint, 0.6 for an outlier, 0.4 for a hidden one, 0 for a missing one.

The presets are chosen so that unweighted DLT on the `human36m_like` rig errs within 20 % of the simulated
detections of DESIGN §3 (mm, theirs second): good 21.7, 22.4; noisy 24.6, 25.5; occluded(2) 53.0, 49.7;
occluded(3) 66.1, 64.9; occluded(3, hard=True) 196.8, 198.0 (``pytest tests/synthetic -k design``). Those with
memory are chosen so that `skelsplat.refine`, frame by frame and without confidences, errs about as in the
recordings of DESIGN §7: recording 16.5, 16.5; recording_occluded(2) 26.1, 27.3; recording_occluded(3) 37.8,
36.8; recording_occluded(3, heavy=True) 113.1, 120.0 (``python benchmarks/sequences.py --methods frames``).
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from skelsplat.exceptions import InvalidInputError
from skelsplat.synthetic.memory import Memory, Range, check_range

SIZE_IN_ROOM = 1147.0 / 5300.0
"""Size of people in the images for which the presets are made: focal length, px, over distance, mm."""


def stream(*key: int) -> np.random.Generator:
    """Random numbers that belong to `key`: the seed, the places in the set, what they are for."""
    return np.random.default_rng(key)


@dataclass(frozen=True, kw_only=True)
class DetectionNoise:
    """Parameters of the simulated detector; the module's docstring says what each effect does.

    Rates are probabilities, lengths px. The default has jitter only. `occluded_views` None is all views;
    `disc_radius` is the range of the radius as a share of the longer side of the box round the body.
    """

    sigma_px: float = 4.0
    outlier_rate: float = 0.0
    outlier_px: float = 40.0
    limb_swap_rate: float = 0.0
    view_swap_rate: float = 0.0
    miss_rate: float = 0.0
    occluded_views: int | None = 0
    n_discs: int = 1
    disc_radius: Range = (0.1, 0.2)
    hidden_missing_rate: float = 0.0
    hidden_drawn_rate: float = 0.0
    memory: Memory | None = None

    def __post_init__(self) -> None:
        check_range(self, 0.0, np.inf, "sigma_px", "outlier_px")
        check_range(self, 0.0, 1.0, *(entry.name for entry in fields(self) if entry.name.endswith("_rate")))
        check_range(self, 1, np.inf, "n_discs")
        if self.occluded_views is not None:
            check_range(self, 0, np.inf, "occluded_views")
        low, high = self.disc_radius
        if not 0.0 <= low <= high < np.inf:
            raise InvalidInputError(f"disc_radius: expected 0 <= low <= high, got {self.disc_radius!r}")

    def scaled(self, factor: float) -> DetectionNoise:
        """Return the same detector for people who are `factor` times as large in the images."""
        return replace(self, sigma_px=factor * self.sigma_px, outlier_px=factor * self.outlier_px)

    @classmethod
    def good(cls) -> DetectionNoise:
        """Simulate a good detector: small jitter, few outliers."""
        return cls(sigma_px=2.3, outlier_rate=0.03, outlier_px=28.0)

    @classmethod
    def noisy(cls) -> DetectionNoise:
        """Simulate a detector with more jitter, some misses."""
        return cls(sigma_px=3.0, outlier_rate=0.025, outlier_px=25.0, miss_rate=0.01)

    @classmethod
    def occluded(cls, n_views: int | None, *, hard: bool = False) -> DetectionNoise:
        """Simulate the good detector with an occluder in each of `n_views` views (None = all).

        With `hard` it is two larger ones, and a hidden joint is never missing: always a gross error.
        """
        return cls.good()._behind(n_views, (0.1, 0.22), heavy=hard)

    @classmethod
    def recording(cls, frame_rate: float = 30.0) -> DetectionNoise:
        """Simulate a detector on a recording of that many frames per second: its errors have a memory."""
        return cls(sigma_px=2.4, outlier_rate=0.03, outlier_px=28.0, memory=Memory(frame_rate=frame_rate))

    @classmethod
    def recording_occluded(
        cls, n_views: int | None, *, heavy: bool = False, frame_rate: float = 30.0
    ) -> DetectionNoise:
        """Simulate the detector of `recording` with occluders; `n_views` and `heavy` as in `occluded`."""
        return cls.recording(frame_rate)._behind(n_views, (0.13, 0.28), heavy=heavy)

    def _behind(self, n_views: int | None, radius: Range, *, heavy: bool) -> DetectionNoise:
        discs, radius, missing = (2, (0.16, 0.32), 0.0) if heavy else (1, radius, 0.1)
        return replace(
            self, occluded_views=n_views, n_discs=discs, disc_radius=radius, hidden_missing_rate=missing
        )
