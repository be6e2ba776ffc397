"""Evaluation of several people without oracle association: who is found, how well, under how many names.

>>> from skelsplat.evaluation import people
>>> people.names
('track', 'affinity', 'oracle')
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from skelsplat import metrics
from skelsplat._arrays import Array, Index, Mask
from skelsplat._people import track
from skelsplat._sequence import refine_sequence
from skelsplat._skelsplat import Layout, RefineConfig
from skelsplat.datasets import Dataset, PeopleTake
from skelsplat.evaluation import protocols
from skelsplat.evaluation.baselines import affinity
from skelsplat.evaluation.methods import Options, stretches, without_lens
from skelsplat.evaluation.protocols import Endpoint, Protocol
from skelsplat.evaluation.report import Evaluation, Figure, Figures, Heard, lines
from skelsplat.evaluation.scores import mean_interval
from skelsplat.evaluation.tables import Report, Table, interval
from skelsplat.exceptions import DatasetError, one_of
from skelsplat.io import convert_unit
from skelsplat.metrics._people import share

Tracks = Sequence[tuple[int, Index, Array]]
"""Identity, frames (F,), poses (F, N, 3) mm of each person found. An identity may come in pieces."""

SWAP_S = 0.5  # an identity that follows two people for longer than this each is a swap


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
        found = {}
        for name, total in totals.items():
            n, hits, error, parts = total.tolist()
            figures = {"recall": share(hits, n), "mean_mm": share(error, hits), "pcp": parts / n}
            found[name] = {"person_frames": n, **figures}
        return found

    def lines(self, method: str, oracle: Tally | None) -> list[Figures]:
        """Return the figures of a method, over all and of each scene and person."""
        reference = None if oracle is self else oracle
        scenes = {key: self.figures(reference, key) for key in self.scenes}
        whole = {"": self.figures(reference)}
        return lines(method, {"all": whole, "scene": scenes, "person": self.people()})

    def _change(self, reference: Tally, keys: Sequence[str]) -> float:
        own, other = [], []
        for key in keys:
            here, there = self.scenes[key], reference.scenes[key]
            both = here.kept & there.kept
            own.append(here.scores.error_mm[both])
            other.append(there.scores.error_mm[both])
        a, b = np.concatenate(own), np.concatenate(other)
        return float(a.mean() / b.mean() - 1.0) if len(a) else float("nan")


def _track(scene: PeopleTake, layout: Layout, config: RefineConfig) -> Tracks:
    found = track(scene.people, scene.rig, fps=scene.fps, layout=layout, config=config)
    return [(one.id, one.frames, scene.rig.mm_per_unit * one.refinement.pose) for one in found]


def _oracle(scene: PeopleTake, layout: Layout, config: RefineConfig) -> Tracks:
    """Solve every person from the detections that are theirs, where two views have them."""
    out = []
    for q, detections in enumerate(scene.detections()):
        (frames,) = np.nonzero((scene.slots[q] >= 0).sum(axis=-1) >= 2)
        if len(frames):
            solved = refine_sequence(detections, scene.rig, fps=scene.fps, layout=layout, config=config)
            out.append((q, frames, scene.rig.mm_per_unit * solved.pose[frames]))
    return out


METHODS: Mapping[str, Callable[[PeopleTake, Layout, RefineConfig], Tracks]] = {
    "track": _track,  # skelsplat.track
    # affinity of rays, greedy groups, DLT, nearest neighbour
    "affinity": lambda scene, *_: affinity.track(scene.people, convert_unit(scene.rig, "mm"), fps=scene.fps),
    "oracle": _oracle,  # over time, with detections associated by the ground truth
}
"""By name, what makes tracks of a scene: frames are places in the take, poses in mm."""

names: tuple[str, ...] = tuple(METHODS)

_COLUMNS = {
    "precision": Figure("prec.", best="high", factor=100),
    "recall": Figure("rec.", best="high", title="recall, %", factor=100),
    "mean_mm": Figure("MPJPE", best="low", title="MPJPE, mm"),
    "interval": Figure("95 % CI"),
    "pcp": Figure("PCP", best="high", title="PCP, %", factor=100),
    "idf1": Figure("IDF1", best="high", factor=100),
    "identity_switches": Figure("IDS", 0),
    "fragmentations": Figure("frag", 0),
    "scenes_clean": Figure("clean", 0, factor=100),
    "scenes_swapped": Figure("swap", 0, factor=100),
    "change": Figure("vs. oracle", factor=100),
    "ms_per_frame": Figure("ms/frame", 2),
}
CSV_FIELDS = ("method", "group", "name", *(key for key in _COLUMNS if key != "interval"), "person_frames")
"""Columns of the CSV: ``group`` is all, scene or person; shares are from 0 to 1; empty means no number."""


PeopleCase = tuple[PeopleTake, Mask]
"""Consecutive frames of a scene, and which of them (T,) count."""


@dataclass(frozen=True, kw_only=True, eq=False)
class People(Evaluation):
    """What `evaluate` found."""

    cases: tuple[PeopleCase, ...]

    def report(self) -> Report:
        """Return tables and figures; printed are that of methods and the first by person."""
        figures = ("pcp", "mean_mm", "recall") if self.protocol.parts else ("mean_mm", "recall")
        scenes = [
            {"key": scene.key, "frames": int(judged.sum()), "people": scene.names, "views": len(scene.rig)}
            for scene, judged in self.cases
        ]
        return Report(
            title=self.dataset.name,
            tables=(self.methods_table(), *(self.by("person", key, "person", "all") for key in figures)),
            shown=2,
            fields=CSV_FIELDS,
            rows=self.lines,
            values=self.values(protocol={"least_views": self.protocol.least_views}, scenes=scenes),
        )

    def methods_table(self) -> Table:
        """One row per method, and under it what the columns mean."""
        extra = "" if self.protocol.least_views else " Who finds people without a truth loses precision."
        return self.overall(
            "precision, recall, PCP and IDF1 in %, MPJPE in mm",
            "Who is who is not given, except to oracle, which takes the detections that the ground truth "
            "associates with each person.",
            f"Protocol: {self.protocol.text} Estimates are assigned to people frame by frame, up to 500 mm "
            f"of mean joint distance; MPJPE is of the assigned ones.{extra}",
            "IDS, frag: identity switches and fragmentations (CLEAR MOT), in all scenes; clean: scenes "
            "without a switch, %; swap: scenes in which one identity follows two people for half a second "
            "each, %. vs. oracle: change of MPJPE, %, where both methods have a person and neither confuses "
            "them. 95 % CI: of MPJPE, by bootstrap over scenes. Time: the method alone.",
            "" if self.published is None else self.published.note(),
        )


def cases(dataset: Dataset, protocol: Protocol) -> tuple[PeopleCase, ...]:
    """Cut the scenes into stretches of consecutive frames, of which some count.

    Raises `DatasetError` if the data set has no detections of several people, or no frame counts.
    """
    if not dataset.scenes:
        expected = "detections of everybody in view, in any order (docs/howto/evaluation.md)"
        raise DatasetError(dataset.name, "people", expected, "none, or those of one person each")
    found = []
    for scene in dataset.scenes:
        keep = protocol.counted(scene.frames)
        parts = [part for part in stretches(scene.frames) if keep[part].any()]
        for k, part in enumerate(parts):
            key = scene.key if len(parts) == 1 else f"{scene.key}, part {k + 1}"
            found.append((replace(scene.select(part), key=key), keep[part]))
    if not found:
        raise DatasetError(dataset.name, "frames", f"frames for the protocol {protocol.name}", "none")
    return tuple(found)


def evaluate(
    dataset: Dataset,
    chosen: Sequence[str] = (),
    options: Options | None = None,
    *,
    protocol: Protocol | None = None,
    report: Heard | None = None,
) -> People:
    """Run methods, by default all, on the scenes of a data set and score them.

    Of the `options` `undistort` and `n_threads` apply; the default protocol is that of the data set's name.
    Raises `InvalidInputError` for an unknown method, `DatasetError` without detections of several people.
    """
    options = options or Options()
    rules = protocols.get(dataset.name) if protocol is None else protocol
    picked = list(dict.fromkeys(chosen or names))
    for name in picked:
        one_of("methods", name, names)
    parts, config = cases(dataset, rules), RefineConfig(n_threads=options.n_threads)
    total, done = len(picked) * sum(len(scene) for scene, _ in parts), 0
    tallies = {name: Tally() for name in picked}
    for name in picked:
        for scene, judged in parts:
            if report is not None:
                report(name, scene.key, done, total)
            seen = scene if options.undistort else replace(scene, rig=without_lens(scene.rig))
            begun = time.perf_counter()
            tracks = METHODS[name](seen, dataset.layout, config)
            _score(tallies[name], tracks, time.perf_counter() - begun, scene, judged, rules)
            done += len(scene)
    views = ", ".join(map(str, sorted({len(scene.rig) for scene, _ in parts})))
    shared = {"undistort": options.undistort}
    solver = {**shared, "config": config.to_dict()}
    return People(
        dataset=dataset,
        protocol=rules,
        settings={name: shared if name == "affinity" else solver for name in picked},
        subject=f"{dataset.name} ({dataset.detector or 'no detections'}), {views} views, {len(parts)} scenes",
        lines=tuple(line for name in picked for line in tallies[name].lines(name, tallies.get("oracle"))),
        columns=_COLUMNS,
        cases=parts,
    )


def _score(
    tally: Tally, tracks: Tracks, seconds: float, scene: PeopleTake, judged: Mask, rules: Protocol
) -> None:
    place = np.where(judged, np.cumsum(judged) - 1, -1)  # among the frames that count
    tally.add(
        scene.key,
        [(who, place[frames][judged[frames]], pose[judged[frames]]) for who, frames, pose in tracks],
        scene.rig.mm_per_unit * scene.truth[:, judged],
        scene.optional(rules.least_views)[:, judged],
        seconds * float(judged.mean()),
        fps=scene.fps,
        names=scene.names,
        parts=rules.parts or None,
    )
