"""Several people: who is told apart, who is confused, and what the confusion costs.

    python benchmarks/people.py [--people 3 4] [--views 4 5] [--scenes 5] [--meetings cross leave]

Simulated scenes (`skelsplat.synthetic.simulate_scene`): detections of two people as one, of one as two, of
nobody, and people behind each other. Every combination of people, views and meetings is a condition; "all"
takes turns, and in "cmu" people of the CMU motion capture pass each other (0.3 m or more) in the middle of
the room, for as long as the longest take. Methods: `oracle` solves every person from the detections that
show them mostly; `tracker` is `skelsplat.track`; `baseline` is `skelsplat.evaluation.baselines.affinity`.

precision, recall: of people found within `--gate` mm, in frames in which at least two views detect them.
clean: scenes without an identity switch; swap: those in which one identity follows two people for longer than
half a second each. IDS, frag: identity switches and fragmentations (CLEAR MOT) per scene. mean mm: mean joint
distance. vs. oracle: change of that mean where both methods have a person whom the method has not confused.
ms: per frame, one core.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import _one_core  # noqa: F401  before numpy
import common
import numpy as np
import recordings as motion_capture
from numpy.typing import NDArray
from scenarios import FloatArray

import skelsplat as sk
from skelsplat import metrics, synthetic
from skelsplat.evaluation.baselines import affinity
from skelsplat.synthetic import Crowding, DetectionNoise, Scene

Tracks = list[tuple[int, NDArray[np.int64], FloatArray]]
CONFIG = sk.RefineConfig(n_threads=1)
CROWDING = {"none": Crowding.none(), "usual": Crowding(), "heavy": Crowding.heavy()}
RADIUS_MM = 4500.0
SIZE_IN_ROOM = 1147.0 / 5300.0  # px/mm, for which `DetectionNoise.recording_occluded` is made
SWAP_S = 0.5
# Of the CMU takes: their length, how near people come, and how many arrangements are tried.
MIN_FRAMES, MAX_FRAMES = 75, 350
NEAREST_MM, DRAWS = 300.0, 200
COLUMNS = [
    "",
    "prec. %",
    "rec. %",
    "IDF1 %",
    "clean %",
    "swap %",
    "IDS",
    "frag",
    "mean mm",
    "vs. oracle",
    "ms",
]


def level(n_views: int) -> sk.CameraRig:
    """All cameras at one height, among people's shoulders."""
    return synthetic.ring(n_views, radius_mm=RADIUS_MM, height_mm=1500.0)


def mixed(n_views: int) -> sk.CameraRig:
    """Cameras 1.2 and 2.6 m high in turn."""
    low, high = (synthetic.ring(n_views, radius_mm=RADIUS_MM, height_mm=h) for h in (1200.0, 2600.0))
    return sk.CameraRig([(low, high)[k % 2][k] for k in range(n_views)])


def dome(n_views: int) -> sk.CameraRig:
    """Cameras of a dome, as in CMU Panoptic."""
    return synthetic.dome(n_views, radius_mm=RADIUS_MM)


RIGS: dict[str, Callable[[int], sk.CameraRig]] = {"level": level, "mixed": mixed, "dome": dome}


def oracle(scene: Scene) -> Tracks:
    """Solve every person from their own detections, in the frames in which two views have them."""
    out = []
    judged = ~scene.optional()
    for q, detections in enumerate(scene.detections()):
        (frames,) = np.nonzero(judged[q])
        if len(frames):
            solved = sk.refine_sequence(
                detections, scene.cameras, fps=scene.fps, layout=scene.layout, config=CONFIG
            )
            out.append((q, frames, solved.pose[frames]))
    return out


def tracker(scene: Scene) -> Tracks:
    """Run `sk.track`."""
    track: Any = getattr(sk, "track")  # noqa: B009  absent from older versions
    found = track(scene.people, scene.cameras, fps=scene.fps, layout=scene.layout, config=CONFIG)
    return [(one.id, np.asarray(one.frames), one.refinement.pose) for one in found]


def baseline(scene: Scene) -> Tracks:
    """Run `affinity.track`."""
    return affinity.track(scene.people, scene.cameras, fps=scene.fps)


METHODS: dict[str, Callable[[Scene], Tracks]] = {"oracle": oracle, "tracker": tracker, "baseline": baseline}


@dataclass
class Tally:
    """Scores of a method in the scenes of a condition."""

    scores: list[metrics.TrackScores] = field(default_factory=list)
    swapped: int = 0
    frames: int = 0
    seconds: float = 0.0
    kept: list[NDArray[np.bool_]] = field(default_factory=list)  # (Q, T) person-frames not confused

    def add(self, scene: Scene, tracks: Tracks, seconds: float, gate_mm: float = 500.0) -> None:
        """Score one scene."""
        optional = scene.optional()
        scores = metrics.track_scores(tracks, scene.truth, optional=optional, gate_mm=gate_mm)
        self.scores.append(scores)
        self.frames += len(scene.people)
        self.seconds += seconds
        shares = {name: (scores.matched == name).sum(axis=1) for name, _, _ in tracks}
        self.swapped += any((share > SWAP_S * scene.fps).sum() > 1 for share in shares.values())
        whose = np.array([[q == shares[n].argmax() if n >= 0 else False for n in own.tolist()]
                          for q, own in enumerate(scores.matched)])  # fmt: skip
        self.kept.append(whose & ~optional)

    def figures(self, reference: Tally | None) -> dict[str, float]:
        """Return the means over all scenes, person-frame by person-frame."""
        hits = sum(one.recall * one.n_truth for one in self.scores)
        n_truth, n_estimates = (
            sum(getattr(one, key) for one in self.scores) for key in ("n_truth", "n_estimates")
        )
        return {
            "precision": hits / max(n_estimates, 1),
            "recall": hits / max(n_truth, 1),
            "idf1": float(np.mean([one.idf1 for one in self.scores])),
            "scenes_clean": float(np.mean([one.identity_switches == 0 for one in self.scores])),
            "scenes_swapped": self.swapped / len(self.scores),
            "identity_switches": float(np.mean([one.identity_switches for one in self.scores])),
            "fragmentations": float(np.mean([one.fragmentations for one in self.scores])),
            "mean_mm": sum(np.nan_to_num(one.mpjpe_mm) * one.recall * one.n_truth for one in self.scores)
            / max(hits, 1),
            "change": self.change(reference) if reference is not None else float("nan"),
            "ms_per_frame": 1000.0 * self.seconds / self.frames,
        }

    def change(self, reference: Tally) -> float:
        """Return by what share the mean error is above the reference's, where both have the same person."""
        both = [a & b for a, b in zip(self.kept, reference.kept, strict=True)]
        own, other = (
            np.concatenate([one.error_mm[mask] for one, mask in zip(tally.scores, both, strict=True)])
            for tally in (self, reference)
        )
        return float(own.mean() / other.mean() - 1.0) if len(own) else float("nan")


def captured(people: int, rng: np.random.Generator) -> list[FloatArray]:
    """Return CMU takes (T, 17, 3) mm that meet in the middle of the room without a bump.

    Everybody is there for as long as their take, its middle in the middle of the scene.
    """
    takes = [take for take in motion_capture.motions().values() if MIN_FRAMES <= len(take) <= MAX_FRAMES]
    best, widest = [np.empty((0, 17, 3))], -np.inf
    for _ in range(DRAWS):
        chosen = [takes[k] for k in rng.choice(len(takes), size=people, replace=False)]
        n_frames = max(map(len, chosen))
        placed = []
        for take in chosen:
            angle, half = rng.uniform(0.0, 2 * np.pi), len(take) // 2
            turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
            pose = np.full((n_frames, 17, 3), np.nan)
            own = pose[n_frames // 2 - half :][: len(take)]
            own[:] = take
            own[..., :2] = (take[..., :2] - take[half, 0, :2]) @ turn + rng.normal(0.0, 300.0, size=2)
            placed.append(pose)
        gaps = [np.linalg.norm(a[:, 0] - b[:, 0], axis=-1) for k, a in enumerate(placed) for b in placed[:k]]
        if (gap := float(np.nanmin(gaps))) > widest:
            best, widest = placed, gap
        if widest >= NEAREST_MM:
            break
    return best


def scenes(people: int, views: int, meeting: str, chosen: argparse.Namespace) -> list[Scene]:
    """Simulate the scenes of a condition."""
    kinds = (
        [kind for kind in synthetic.meeting_names if kind != "apart"]
        if meeting in ("all", "cmu")
        else [meeting]
    )
    rig, occluded = RIGS[chosen.rig](views), None
    if chosen.occluded:
        usual = DetectionNoise.recording_occluded(chosen.occluded, frame_rate=chosen.fps)
        occluded = usual.scaled(float(np.median([c.K[0, 0] for c in rig])) / RADIUS_MM / SIZE_IN_ROOM)
    return [
        synthetic.simulate_scene(
            captured(people, np.random.default_rng([chosen.seed, k])) if meeting == "cmu" else people,
            rig,
            n_frames=round(chosen.seconds * chosen.fps),
            fps=chosen.fps,
            meetings=kinds,
            bystander=chosen.bystander,
            noise=occluded,
            crowding=CROWDING[chosen.crowding],
            seed=chosen.seed + k,
        )
        for k in range(chosen.scenes)
    ]


def measured(recordings: list[Scene], names: list[str], gate_mm: float) -> dict[str, Tally]:
    """Run every method on every scene."""
    out = {}
    for name in names:
        out[name] = Tally()
        for scene in recordings:
            begun = time.perf_counter()
            tracks = METHODS[name](scene)
            out[name].add(scene, tracks, time.perf_counter() - begun, gate_mm)
    return out


def options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    kinds = (*synthetic.meeting_names, "all", "cmu")
    methods = [name for name in METHODS if name != "tracker" or hasattr(sk, "track")]
    parser.add_argument("--people", type=int, nargs="+", default=[3], metavar="Q", help="2 to 6 (3)")
    parser.add_argument("--views", type=int, nargs="+", default=[4], metavar="M", help="3 to 8 (4)")
    parser.add_argument("--meetings", nargs="+", choices=kinds, default=["all"], help=f"{kinds} (all)")
    parser.add_argument("--scenes", type=int, default=5, metavar="K", help="per condition (5)")
    parser.add_argument("--seconds", type=float, default=10.0, help="length of a scene (10)")
    parser.add_argument("--fps", type=float, default=30.0, help="frames per second (30)")
    parser.add_argument("--rig", choices=RIGS, default="mixed", help="mixed (default), level or dome")
    parser.add_argument("--crowding", choices=CROWDING, default="usual", help="what goes wrong (usual)")
    parser.add_argument("--bystander", action="store_true", help="add a person whom two cameras see")
    parser.add_argument(
        "--occluded", type=int, metavar="N", help="views with an occluder over each person (0)"
    )
    parser.add_argument("--methods", nargs="+", choices=methods, default=methods, help=f"{methods}")
    parser.add_argument("--gate", type=float, default=500.0, metavar="MM", help="of a match (500)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--markdown", action="store_true", help="print Markdown")
    parser.add_argument("--json", action="store_true", help="print JSON only")
    return parser.parse_args()


def cells(figures: dict[str, float]) -> list[str]:
    """Return a row of the table."""
    shares = [f"{100 * figures[key]:.1f}" for key in ("precision", "recall", "idf1")]
    shares += [f"{100 * figures[key]:.0f}" for key in ("scenes_clean", "scenes_swapped")]
    counts = [f"{figures[key]:.1f}" for key in ("identity_switches", "fragmentations", "mean_mm")]
    change = figures["change"]
    return [
        *shares,
        *counts,
        "–" if np.isnan(change) else f"{100 * change:+.1f}",
        f"{figures['ms_per_frame']:.2g}",
    ]


def unclean(tallies: dict[str, Tally], first: int) -> list[str]:
    """Return a line per method on the seeds of the scenes with identity switches."""
    lines = []
    for name, tally in tallies.items():
        seeds = [str(first + k) for k, one in enumerate(tally.scores) if one.identity_switches]
        if seeds:
            lines.append(f"{name}: identity switches in the scenes of seed {', '.join(seeds)}")
    return lines


def main() -> None:
    chosen = options()
    report = {}
    for people in chosen.people:
        for views in chosen.views:
            for meeting in chosen.meetings:
                name = f"{people} people, {views} views, {meeting}"
                tallies = measured(scenes(people, views, meeting, chosen), chosen.methods, chosen.gate)
                reference = tallies.get("oracle")
                report[name] = {
                    method: tally.figures(None if method == "oracle" else reference)
                    for method, tally in tallies.items()
                }
                if not chosen.json:
                    rows = [[method, *cells(figures)] for method, figures in report[name].items()]
                    title = f"{name}: {chosen.scenes} scenes, cameras {chosen.rig}, simulated"
                    common.show(title, COLUMNS, rows, markdown=chosen.markdown)
                    print("\n".join([*unclean(tallies, chosen.seed), ""]))
    if chosen.json:
        print(json.dumps({"circumstances": common.circumstances(), "conditions": report}, indent=2))
        return
    if not hasattr(sk, "track"):
        print("without tracker: this version of skelsplat has no track")
    print(common.circumstances())


if __name__ == "__main__":
    main()
