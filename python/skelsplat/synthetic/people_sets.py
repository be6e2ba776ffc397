"""A simulated data set of several people: scenes in which they meet, seen by two detectors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skelsplat import layouts
from skelsplat.cameras import CameraRig
from skelsplat.exceptions import InvalidInputError
from skelsplat.synthetic import rigs
from skelsplat.synthetic.crowding import Crowding
from skelsplat.synthetic.crowds import meeting_names
from skelsplat.synthetic.scenes import Scene, simulate_scene
from skelsplat.synthetic.sets import Recording, RecordingSet

PEOPLE_SET = "people"
"""Name of the set."""

RADIUS_MM = 4500.0
"""Distance of the cameras from the middle of the room."""

CROWDED: Mapping[str, Crowding] = {"good": Crowding(), "noisy": Crowding.heavy()}
"""Detectors: what each does wrong because several people are there. Of one person alone they are the same."""

MEETINGS = tuple(name for name in meeting_names if name != "apart")

_RIG = "ring"
_FRAMES, _FPS = 300, 30.0
_MOST_SCENES = 1000


def mixed_heights(n_views: int) -> CameraRig:
    """Return a ring of cameras that are 1.2 and 2.6 m high in turn."""
    low, high = (rigs.ring(n_views, radius_mm=RADIUS_MM, height_mm=h) for h in (1200.0, 2600.0))
    return CameraRig([(low, high)[k % 2][k] for k in range(n_views)])


def simulate_people_set(
    people: int = 3, views: int = 4, scenes: int = 5, *, frames: int = _FRAMES, seed: int = 0
) -> RecordingSet:
    """Simulate scenes of several people, as `simulate_scene` does, at 30 Hz.

    Parameters
    ----------
    people, views, scenes : int
        2 to 6 people, 3 to 8 cameras, 1 to 1000 scenes.
    frames : int
        Of each scene.
    seed : int
        Scene k of seed S is that of ``simulate_scene(…, seed=1000 * S + k)``.
    """
    limits = {"people": (people, 2, 6), "views": (views, 3, 8), "scenes": (scenes, 1, _MOST_SCENES)}
    for name, (value, least, most) in limits.items():
        if not least <= value <= most:
            raise InvalidInputError(f"{name}: expected an integer from {least} to {most}, got {value!r}")
    for name, value, least in (("frames", frames, 2), ("seed", seed, 0)):
        if value < least:
            raise InvalidInputError(f"{name}: expected an integer >= {least}, got {value!r}")
    rig, made = mixed_heights(views), []
    for k in range(scenes):
        scene_of = partial(simulate_scene, people, rig, n_frames=frames, fps=_FPS, meetings=MEETINGS)
        seen = {
            detector: scene_of(crowding=crowding, seed=_MOST_SCENES * seed + k)
            for detector, crowding in CROWDED.items()
        }
        made.append(_recording(f"scene{k}", seen))
    parameters = {
        "seed": seed,
        "people": people,
        "views": views,
        "scenes": scenes,
        "frames": frames,
        "meetings": list(MEETINGS),
        "detectors": {name: asdict(crowding) for name, crowding in CROWDED.items()},
    }
    return RecordingSet(PEOPLE_SET, layouts.H36M17, {_RIG: rig}, tuple(made), parameters, _FPS)


def _recording(key: str, seen: Mapping[str, Scene]) -> Recording:
    """Return a scene as each detector sees it; people and cameras are those of all."""
    first = next(iter(seen.values()))
    arrays: dict[str, dict[str, NDArray[Any]]] = {
        f"people_simulated_{detector}": {
            "people": scene.people,
            "owner": scene.owner.astype(np.int16),
            "joint_owner": scene.joint_owner.astype(np.int16),
        }
        for detector, scene in seen.items()
    }
    arrays["truth"] = {"poses": first.truth, "visible": first.visible}
    frames = np.arange(len(first.people))
    return Recording(key, key, "people", _RIG, frames, arrays, people=len(first.truth))
