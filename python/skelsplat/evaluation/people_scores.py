"""Figures of a method that finds out who is who, over scenes, people and all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from skelsplat import metrics
from skelsplat._arrays import Array, Index, Mask
from skelsplat.evaluation.protocols import Endpoint
from skelsplat.evaluation.scores import mean_interval
from skelsplat.metrics._people import share

Tracks = Sequence[tuple[int, Index, Array]]
"""Identity, frames (F,), poses (F, N, 3) mm of each person found. An identity may come in pieces."""

SWAP_S = 0.5
"""An identity that follows two people for longer than this each is a swap."""


@dataclass(frozen=True, slots=True, eq=False)
class _Scored:
    """One scene: its scores, which person-frames count, and whom no identity was confused about."""

    scores: metrics.TrackScores
    counted: Mask  # (Q, T)
    kept: Mask  # (Q, T): matched to the identity that is mostly this person's
    swapped: bool
    names: tuple[str, ...]

    @property
    def hits(self) -> Mask:
        """Person-frames that count and are found, (Q, T)."""
        return np.asarray(self.counted & (self.scores.matched >= 0))


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
        names: Sequence[str] | None = None,
        parts: Sequence[tuple[Endpoint, Endpoint]] | None = None,
        gate_mm: float = 500.0,
    ) -> None:
        """Score the tracks of a scene, `key`, of Q people: truth (Q, T, N, 3) mm, optional (Q, T)."""
        scores = metrics.track_scores(tracks, truth, optional=optional, gate_mm=gate_mm, limbs=parts)
        found = sorted({name for name, _, _ in tracks})
        # How often each identity is each person.
        shares = np.array([(scores.matched == name).sum(axis=1) for name in found]).reshape(-1, len(truth))
        whose = dict(zip(found, shares.argmax(axis=1).tolist(), strict=True))
        owner = np.vectorize(lambda name: whose.get(name, -1), otypes=[np.int64])(scores.matched)
        counted = np.isfinite(truth).all(axis=-1).any(axis=-1) & ~optional
        self.scenes[key] = _Scored(
            scores,
            counted,
            counted & (owner == np.arange(len(truth))[:, None]),
            bool(((shares > SWAP_S * fps).sum(axis=1) > 1).any()),
            tuple(map(str, range(len(truth)))) if names is None else tuple(names),
        )
        self.frames += truth.shape[1]
        self.seconds += seconds

    def figures(self, reference: Tally | None = None, key: str | None = None) -> dict[str, float]:
        """Return the figures of a scene, or of all: person-frame by person-frame.

        ``change`` is that of the mean error against the `reference`, where both have a person whom neither
        has confused. Ratios of nothing are NaN.
        """
        every = list(self.scenes) if key is None else [key]
        scored = [self.scenes[key] for key in every]
        scores = [one.scores for one in scored]
        hits = sum(int(one.hits.sum()) for one in scored)
        n_truth, n_estimates = (sum(one.n_truth for one in scores), sum(one.n_estimates for one in scores))
        sums = [float(one.scores.error_mm[one.hits].sum()) for one in scored]
        low, high = mean_interval(sums, [float(one.hits.sum()) for one in scored])
        people = self.people(every)
        return {
            "person_frames": n_truth,
            "precision": share(hits, n_estimates),
            "recall": share(hits, n_truth),
            "mean_mm": share(sum(sums), hits),
            "mean_low_mm": low,
            "mean_high_mm": high,
            "pcp": float(np.mean([one["pcp"] for one in people.values()])) if people else float("nan"),
            "identity_switches": sum(one.identity_switches for one in scores),
            "fragmentations": sum(one.fragmentations for one in scores),
            "idf1": float(np.mean([one.idf1 for one in scores])),
            "scenes_clean": float(np.mean([one.identity_switches == 0 for one in scores])),
            "scenes_swapped": float(np.mean([one.swapped for one in scored])),
            "change": float("nan") if reference is None else self._change(reference, every),
            "ms_per_frame": 1000.0 * self.seconds / self.frames if key is None else float("nan"),
        }

    def people(self, keys: Sequence[str] | None = None) -> dict[str, dict[str, float]]:
        """Return recall, mean error and PCP by the name of each person who counts."""
        totals: dict[str, list[Array]] = {}
        for key in self.scenes if keys is None else keys:
            one = self.scenes[key]
            pcp = np.full(len(one.names), np.nan) if one.scores.pcp is None else one.scores.pcp
            for q, name in enumerate(one.names):
                n, hit = one.counted[q].sum(), one.hits[q]
                if n:
                    row = np.array([n, hit.sum(), one.scores.error_mm[q, hit].sum(), n * pcp[q]])
                    totals.setdefault(name, []).append(row)
        sums = {name: np.sum(rows, axis=0).tolist() for name, rows in totals.items()}
        return {
            name: {
                "person_frames": n,
                "recall": share(hits, n),
                "mean_mm": share(error, hits),
                "pcp": parts / n,
            }
            for name, (n, hits, error, parts) in sums.items()
        }

    def _change(self, reference: Tally, keys: Sequence[str]) -> float:
        pairs = [(self.scenes[key], reference.scenes[key]) for key in keys]
        both = [own.kept & other.kept for own, other in pairs]
        own, other = (
            np.concatenate([pair[side].scores.error_mm[mask] for pair, mask in zip(pairs, both, strict=True)])
            for side in (0, 1)
        )
        return float(own.mean() / other.mean() - 1.0) if len(own) else float("nan")
