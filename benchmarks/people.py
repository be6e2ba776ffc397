"""Several people: how often they are confused with each other, and how much accuracy that costs.

    python benchmarks/people.py [--people 3 4] [--views 4 5] [--scenes 5] [--meetings cross leave]

Simulated scenes (`skelsplat.synthetic.simulate_scene`): detections of two people as one, of one as two, of
nobody, and people behind each other. Every combination of people (2 to 6), views (3 to 8) and meetings is a
condition; "all" takes turns, and in "cmu" people of the CMU motion capture pass each other (0.3 m or more) in
the middle of the room, for as long as the longest take. Rigs: mixed, level or dome; crowding: none, usual or
heavy; `--occluded` views have an occluder over each person. Methods: those of `skelsplat.evaluation.people`;
`oracle` solves every person from the detections that show them mostly. `skelsplat synth people` and
`skelsplat evaluate` give the same figures.

precision, recall: of people found within `--gate` mm, in frames in which at least two views detect them.
clean: scenes without an identity switch; swap: those in which one identity follows two people for longer than
half a second each. IDS, frag: identity switches and fragmentations (CLEAR MOT) per scene. mean mm: mean joint
distance. Δ: change of that mean against oracle, where both have a person and neither has confused them.
ms: per frame, one core.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from itertools import product

import lab
import numpy as np
import recordings as motion_capture
from lab import ONE_THREAD, Table
from scenarios import FloatArray

import skelsplat as sk
from skelsplat import synthetic
from skelsplat.datasets import PeopleTake
from skelsplat.evaluation.people import METHODS
from skelsplat.evaluation.people_scores import Tally
from skelsplat.evaluation.protocols import H36M_PARTS
from skelsplat.synthetic import Crowding, DetectionNoise, Scene
from skelsplat.synthetic.people_sets import RADIUS_MM, mixed_heights

CROWDING = {"none": Crowding.none(), "usual": Crowding(), "heavy": Crowding.heavy()}
SIZE_IN_ROOM = 1147.0 / 5300.0  # px/mm, for which `DetectionNoise.recording_occluded` is made
# Of the CMU takes: their length, how near people come, and how many arrangements are tried.
MIN_FRAMES, MAX_FRAMES = 75, 350
NEAREST_MM, DRAWS = 300.0, 200
# All cameras at one height, among people's shoulders; at several; and in a dome, as in CMU Panoptic.
RIGS: dict[str, Callable[[int], sk.CameraRig]] = {
    "level": lambda views: synthetic.ring(views, radius_mm=RADIUS_MM, height_mm=1500.0),
    "mixed": mixed_heights,
    "dome": lambda views: synthetic.dome(views, radius_mm=RADIUS_MM),
}


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


def measured(scene: Scene, key: str, method: str, tally: Tally, gate_mm: float) -> None:
    """Run a method on a scene, and score it."""
    n_people, n_frames = scene.truth.shape[:2]
    names, frames = tuple(map(str, range(n_people))), np.arange(n_frames)
    slots = scene.slots()
    given = PeopleTake("scene", scene.cameras, frames, scene.people, scene.truth, names, slots, scene.fps)
    begun = time.perf_counter()
    tracks = METHODS[method](given, scene.layout, ONE_THREAD)
    taken, optional = time.perf_counter() - begun, scene.optional()
    tally.add(key, tracks, scene.truth, optional, taken, fps=scene.fps, gate_mm=gate_mm, parts=H36M_PARTS)


def row(figures: dict[str, float], scenes: int) -> dict[str, float | str]:
    """Return a row of the table; switches and fragmentations per scene."""
    percent = round(100 * figures["change"], 1) + 0.0  # never −0.0
    change = "–" if np.isnan(percent) else f"{percent:+.{1 if abs(percent) < 100 else 0}f}"
    heads = {"prec. %": "precision", "rec. %": "recall", "PCP %": "pcp", "IDF1 %": "idf1"}
    heads |= {"clean %": "scenes_clean", "swap %": "scenes_swapped"}
    counts = {"IDS": "identity_switches", "frag": "fragmentations"}
    return {
        **{head: 100 * figures[key] for head, key in heads.items()},
        **{head: figures[key] / scenes for head, key in counts.items()},
        "mean mm": figures["mean_mm"],
        "Δ %": change,
        "ms": figures["ms_per_frame"],
    }


def people(
    *,
    people: tuple[int, ...] = (3,),
    views: tuple[int, ...] = (4,),
    meetings: tuple[str, ...] = ("all",),
    scenes: int = 5,
    seconds: float = 10.0,
    fps: float = 30.0,
    rig: str = "mixed",
    crowding: str = "usual",
    bystander: bool = False,
    occluded: int = 0,
    methods: tuple[str, ...] = tuple(METHODS),
    gate: float = 500.0,
    seed: int = 0,
) -> Iterator[Table]:
    """Simulate scenes, and compare methods."""
    for n_people, n_views, meeting in product(people, views, meetings):
        kinds = [meeting]
        if meeting in ("all", "cmu"):
            kinds = [kind for kind in synthetic.meeting_names if kind != "apart"]
        cameras, noise = RIGS[rig](n_views), None
        if occluded:
            usual = DetectionNoise.recording_occluded(occluded, frame_rate=fps)
            noise = usual.scaled(float(np.median([c.K[0, 0] for c in cameras])) / RADIUS_MM / SIZE_IN_ROOM)
        tallies = {method: Tally() for method in methods}
        for k in range(scenes):
            moving = captured(n_people, np.random.default_rng([seed, k])) if meeting == "cmu" else n_people
            scene = synthetic.simulate_scene(
                moving,
                cameras,
                n_frames=round(seconds * fps),
                fps=fps,
                meetings=kinds,
                bystander=bystander,
                noise=noise,
                crowding=CROWDING[crowding],
                seed=seed + k,
            )
            for method, tally in tallies.items():
                measured(scene, str(seed + k), method, tally, gate)
        rows, notes = {}, []
        for method, tally in tallies.items():
            reference = None if method == "oracle" else tallies.get("oracle")
            rows[method] = row(tally.figures(reference), scenes)
            seeds = [key for key, one in tally.scenes.items() if one.scores.identity_switches]
            if seeds:
                notes.append(f"{method}: identity switches in the scenes of seed {', '.join(seeds)}")
        title = f"{n_people} people, {n_views} views, {meeting}: {scenes} scenes, cameras {rig}, simulated"
        yield Table.of(title, "method", rows, notes)


if __name__ == "__main__":
    lab.main(__doc__, people)
