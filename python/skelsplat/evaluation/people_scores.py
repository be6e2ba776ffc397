"""Figures of a method that finds out who is who, over scenes, people and all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from skelsplat import metrics
from skelsplat._arrays import Array, Index, Mask
from skelsplat.evaluation.protocols import Endpoint
from skelsplat.evaluation.report import Figures
from skelsplat.evaluation.scores import mean_interval
from skelsplat.evaluation.tables import interval
from skelsplat.metrics._people import share

Tracks = Sequence[tuple[int, Index, Array]]
"""Identity, frames (F,), poses (F, N, 3) mm of each person found. An identity may come in pieces."""

SWAP_S = 0.5
"""An identity that follows two people for longer than this each is a swap."""


@dataclass(frozen=True, slots=True, eq=False)
class _Scored:
    """One scene: its scores, which person-frames (Q, T) count, are found, and are not confused."""

    scores: metrics.TrackScores
    counted: Mask
    hits: Mask
    kept: Mask  # matched to the identity that is mostly this person's
    swapped: bool
    names: tuple[str, ...]


@dataclass
class Tally:
    """Scores of a method, scene by scene."""

    scenes: dict[str, _Scored] = field(default_factory=dict)
    frames: int = 0
    seconds: float = 0.0

    def add(
        self,
        key: str,
        tracks: Tracks,
        truth: Array,
        optional: Mask,
        seconds: float,
        *,
        fps: float,
        names: tuple[str, ...],
        parts: Sequence[tuple[Endpoint, Endpoint]] | None = None,
    ) -> None:
        """Score the tracks of a scene, `key`, of Q people: truth (Q, T, N, 3) mm, optional (Q, T)."""
        scores = metrics.track_scores(tracks, truth, optional=optional, limbs=parts)
        found = sorted({name for name, _, _ in tracks})
        # How often each identity is each person.
        shares = np.array([(scores.matched == name).sum(axis=1) for name in found]).reshape(-1, len(truth))
        whose = dict(zip(found, shares.argmax(axis=1).tolist(), strict=True))
        owner = np.vectorize(lambda name: whose.get(name, -1), otypes=[np.int64])(scores.matched)
        counted = np.isfinite(truth).all(axis=-1).any(axis=-1) & ~optional
        self.scenes[key] = _Scored(
            scores,
            counted,
            np.asarray(counted & (scores.matched >= 0)),
            counted & (owner == np.arange(len(truth))[:, None]),
            bool(((shares > SWAP_S * fps).sum(axis=1) > 1).any()),
            names,
        )
        self.frames += truth.shape[1]
        self.seconds += seconds

    def figures(self, reference: Tally | None = None, key: str | None = None) -> Figures:
        """Return the figures of a scene, or of all: person-frame by person-frame.

        ``change`` is that of the mean error against the `reference`, where both have a person whom neither
        has confused. Ratios of nothing are NaN.
        """
        every = list(self.scenes) if key is None else [key]
        scored = [self.scenes[key] for key in every]
        scores = [one.scores for one in scored]
        counts = [int(one.hits.sum()) for one in scored]
        sums = [float(one.scores.error_mm[one.hits].sum()) for one in scored]
        n_truth, hits = sum(one.n_truth for one in scores), sum(counts)
        low, high = mean_interval(sums, counts)
        people = self.people(every)
        return {
            "person_frames": n_truth,
            "precision": share(hits, sum(one.n_estimates for one in scores)),
            "recall": share(hits, n_truth),
            "mean_mm": share(sum(sums), hits),
            "mean_low_mm": low,
            "mean_high_mm": high,
            "interval": interval(low, high),
            "pcp": float(np.mean([one["pcp"] for one in people.values()])) if people else float("nan"),
            "identity_switches": sum(one.identity_switches for one in scores),
            "fragmentations": sum(one.fragmentations for one in scores),
            "idf1": float(np.mean([one.idf1 for one in scores])),
            "scenes_clean": float(np.mean([one.identity_switches == 0 for one in scores])),
            "scenes_swapped": float(np.mean([one.swapped for one in scored])),
            "change": float("nan") if reference is None else self._change(reference, every),
            "ms_per_frame": 1000.0 * self.seconds / self.frames if key is None else float("nan"),
        }

    def people(self, keys: Sequence[str] | None = None) -> dict[str, Figures]:
        """Return recall, mean error and PCP by the name of each person who counts."""
        totals: dict[str, Array] = {}
        for key in self.scenes if keys is None else keys:
            one = self.scenes[key]
            pcp = np.full(len(one.names), np.nan) if one.scores.pcp is None else one.scores.pcp
            for q, name in enumerate(one.names):
                n, hit = one.counted[q].sum(), one.hits[q]
                if n:
                    row = np.array([n, hit.sum(), one.scores.error_mm[q, hit].sum(), n * pcp[q]])
                    totals[name] = totals.get(name, 0.0) + row
        return {
            name: {
                "person_frames": n,
                "recall": share(hits, n),
                "mean_mm": share(error, hits),
                "pcp": parts / n,
            }
            for name, (n, hits, error, parts) in ((name, row.tolist()) for name, row in totals.items())
        }

    def _change(self, reference: Tally, keys: Sequence[str]) -> float:
        pairs = [(self.scenes[key], reference.scenes[key]) for key in keys]
        both = [own.kept & other.kept for own, other in pairs]
        own, other = (
            np.concatenate([pair[side].scores.error_mm[mask] for pair, mask in zip(pairs, both, strict=True)])
            for side in (0, 1)
        )
        return float(own.mean() / other.mean() - 1.0) if len(own) else float("nan")
