"""Several people: how often they are confused with each other, and how much accuracy that costs.

    python benchmarks/people.py [--people 3 4] [--views 4 5] [--scenes 5] [--meetings cross leave]

Simulated scenes (`skelsplat.synthetic.simulate_scene`): detections of two people as one, of one as two, of
nobody, and people behind each other. Every combination of people, views and meetings is a condition; "all"
takes turns, and in "cmu" people of the CMU motion capture pass each other (0.3 m or more) in the middle of
the room, for as long as the longest take. Methods: `track` is `skelsplat.track`; `affinity` is
`skelsplat.evaluation.baselines.affinity`; `oracle` solves every person from the detections that show them
mostly. `skelsplat synth people` and `skelsplat evaluate` give the same figures.

precision, recall: of people found within `--gate` mm, in frames in which at least two views detect them.
clean: scenes without an identity switch; swap: those in which one identity follows two people for longer than
half a second each. IDS, frag: identity switches and fragmentations (CLEAR MOT) per scene. mean mm: mean joint
distance. Δ: change of that mean against oracle, where both have a person and neither has confused them.
ms: per frame, one core.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable

import _one_core  # noqa: F401  before numpy
import common
import numpy as np
import recordings as motion_capture
from scenarios import FloatArray

import skelsplat as sk
from skelsplat import synthetic
from skelsplat.datasets import PeopleTake
from skelsplat.evaluation import people
from skelsplat.evaluation.people_scores import Tally
from skelsplat.evaluation.protocols import H36M_PARTS
from skelsplat.synthetic import Crowding, DetectionNoise, Scene
from skelsplat.synthetic.people_sets import RADIUS_MM, mixed_heights

CONFIG = sk.RefineConfig(n_threads=1)
CROWDING = {"none": Crowding.none(), "usual": Crowding(), "heavy": Crowding.heavy()}
SIZE_IN_ROOM = 1147.0 / 5300.0  # px/mm, for which `DetectionNoise.recording_occluded` is made
# Of the CMU takes: their length, how near people come, and how many arrangements are tried.
MIN_FRAMES, MAX_FRAMES = 75, 350
NEAREST_MM, DRAWS = 300.0, 200
COLUMNS = [
    "",
    "prec. %",
    "rec. %",
    "PCP %",
    "IDF1 %",
    "clean %",
    "swap %",
    "IDS",
    "frag",
    "mean mm",
    "Δ %",
    "ms",
]


def level(n_views: int) -> sk.CameraRig:
    """All cameras at one height, among people's shoulders."""
    return synthetic.ring(n_views, radius_mm=RADIUS_MM, height_mm=1500.0)


def dome(n_views: int) -> sk.CameraRig:
    """Cameras of a dome, as in CMU Panoptic."""
    return synthetic.dome(n_views, radius_mm=RADIUS_MM)


RIGS: dict[str, Callable[[int], sk.CameraRig]] = {"level": level, "mixed": mixed_heights, "dome": dome}


def take(scene: Scene) -> PeopleTake:
    """Return a scene as the methods take it."""
    names = tuple(map(str, range(len(scene.truth))))
    frames = np.arange(len(scene.people))
    return PeopleTake(
        "scene", scene.cameras, frames, scene.people, scene.truth, names, scene.slots(), scene.fps
    )


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
    out: dict[str, Tally] = {}
    for name in names:
        out[name] = Tally()
        for k, scene in enumerate(recordings):
            given = take(scene)
            begun = time.perf_counter()
            tracks = people.get(name).run(given, scene.layout, CONFIG)
            seconds = time.perf_counter() - begun
            optional = scene.optional()
            out[name].add(
                str(k),
                tracks,
                scene.truth,
                optional,
                seconds,
                fps=scene.fps,
                gate_mm=gate_mm,
                parts=H36M_PARTS,
            )
    return out


def options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    kinds = (*synthetic.meeting_names, "all", "cmu")
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
    parser.add_argument(
        "--methods", nargs="+", choices=people.names, default=people.names, help=f"{people.names}"
    )
    parser.add_argument("--gate", type=float, default=500.0, metavar="MM", help="of a match (500)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--markdown", action="store_true", help="print Markdown")
    parser.add_argument("--json", action="store_true", help="print JSON only")
    return parser.parse_args()


def cells(figures: dict[str, float], scenes: int) -> list[str]:
    """Return a row of the table; switches and fragmentations per scene."""
    shares = [f"{100 * figures[key]:.1f}" for key in ("precision", "recall", "pcp", "idf1")]
    shares += [f"{100 * figures[key]:.0f}" for key in ("scenes_clean", "scenes_swapped")]
    counts = [f"{figures[key] / scenes:.1f}" for key in ("identity_switches", "fragmentations")]
    percent = round(100 * figures["change"], 1) + 0.0  # never −0.0
    change = "–" if np.isnan(percent) else f"{percent:+.{1 if abs(percent) < 100 else 0}f}"
    return [*shares, *counts, f"{figures['mean_mm']:.1f}", change, f"{figures['ms_per_frame']:.2g}"]


def unclean(tallies: dict[str, Tally], first: int) -> list[str]:
    """Return a line per method on the seeds of the scenes with identity switches."""
    lines = []
    for name, tally in tallies.items():
        seeds = [str(first + int(k)) for k, one in tally.scenes.items() if one.scores.identity_switches]
        if seeds:
            lines.append(f"{name}: identity switches in the scenes of seed {', '.join(seeds)}")
    return lines


def main() -> None:
    chosen = options()
    report = {}
    for n_people in chosen.people:
        for views in chosen.views:
            for meeting in chosen.meetings:
                name = f"{n_people} people, {views} views, {meeting}"
                tallies = measured(scenes(n_people, views, meeting, chosen), chosen.methods, chosen.gate)
                reference = tallies.get("oracle")
                report[name] = {
                    method: tally.figures(None if method == "oracle" else reference)
                    for method, tally in tallies.items()
                }
                if not chosen.json:
                    rows = [
                        [method, *cells(figures, chosen.scenes)] for method, figures in report[name].items()
                    ]
                    title = f"{name}: {chosen.scenes} scenes, cameras {chosen.rig}, simulated"
                    common.show(title, COLUMNS, rows, markdown=chosen.markdown)
                    print("\n".join([*unclean(tallies, chosen.seed), ""]))
    if chosen.json:
        print(json.dumps({"circumstances": common.circumstances(), "conditions": report}, indent=2))
        return
    print(common.circumstances())


if __name__ == "__main__":
    main()
