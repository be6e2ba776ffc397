"""Several people: how often they are confused with each other, and how much accuracy that costs.

    python benchmarks/people.py [--people 4] [--views 5] [--scenes 5] [--meetings cross]

Simulated scenes (`skelsplat.synthetic.simulate_scene`) of ten seconds at 30 Hz: detections of two people as
one, of one as two, of nobody, and people behind each other. Every combination of people (2 to 6), views (3 to
8) and meetings, which may be repeated, is a condition; "all" takes turns, and in "cmu" people of the CMU
motion capture pass each other in the middle of the room. Crowding: usual or heavy. Time is of one core.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import lab
import numpy as np
import recordings as motion_capture
from lab import Table
from scenarios import FloatArray

from skelsplat import synthetic
from skelsplat.datasets import Dataset, PeopleTake
from skelsplat.evaluation import people as evaluation
from skelsplat.evaluation.methods import Options
from skelsplat.synthetic import Crowding
from skelsplat.synthetic.rigs import mixed_heights

FPS = 30.0
CROWDING = {"usual": Crowding(), "heavy": Crowding.heavy()}
# Of the CMU takes: their length, how near people come, and how many arrangements are tried.
MIN_FRAMES, MAX_FRAMES = 75, 350
NEAREST_MM, DRAWS = 300.0, 200


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


def take(scene: synthetic.Scene, key: str) -> PeopleTake:
    """Return a scene as one of a data set."""
    n_people, n_frames = scene.truth.shape[:2]
    names, frames = tuple(map(str, range(n_people))), np.arange(n_frames)
    return PeopleTake(key, scene.cameras, frames, scene.people, scene.truth, names, scene.slots(), scene.fps)


def people(
    *,
    people: tuple[int, ...] = (3,),
    views: tuple[int, ...] = (4,),
    meetings: tuple[str, ...] = ("all",),
    scenes: int = 5,
    seconds: float = 10.0,
    crowding: str = "usual",
    bystander: bool = False,
    methods: tuple[str, ...] = evaluation.names,
    seed: int = 0,
) -> Iterator[Table]:
    """Simulate scenes, and compare methods."""
    given = {"bystander": bystander, "crowding": CROWDING[crowding]}
    given |= {"n_frames": round(seconds * FPS), "fps": FPS}
    for n_people, n_views, meeting in product(people, views, meetings):
        kinds = [meeting]
        if meeting in ("all", "cmu"):
            kinds = [kind for kind in synthetic.meeting_names if kind != "apart"]
        made = []
        for k in range(seed, seed + scenes):
            moving = captured(n_people, np.random.default_rng([seed, k])) if meeting == "cmu" else n_people
            scene = synthetic.simulate_scene(moving, mixed_heights(n_views), meetings=kinds, seed=k, **given)
            made.append(take(scene, str(k)))
        source = f"{n_people} people, {n_views} views, {meeting}, simulated"
        data = Dataset("people", scene.layout, (), "simulated", source, scenes=tuple(made))
        yield evaluation.evaluate(data, methods, Options(n_threads=1)).methods_table()


if __name__ == "__main__":
    lab.main(__doc__, people)
