"""A simulated data set of several people: scenes in which they meet, seen by two detectors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, ClassVar

import numpy as np

from skelsplat._arrays import Array, Index, Mask
from skelsplat.cameras import CameraRig
from skelsplat.exceptions import InvalidInputError
from skelsplat.synthetic import rigs
from skelsplat.synthetic.crowding import Crowding
from skelsplat.synthetic.crowds import meeting_names
from skelsplat.synthetic.scenes import Scene, simulate_scene
from skelsplat.synthetic.sets import RecordingSet

PEOPLE_SET = "people"
"""Name of the set."""

RADIUS_MM = 4500.0
"""Distance of the cameras from the middle of the room."""

CROWDED: Mapping[str, Crowding] = {"good": Crowding(), "noisy": Crowding.heavy()}
"""Detectors: what each does wrong because several people are there. Of one person alone they are the same."""

MEETINGS = tuple(name for name in meeting_names if name != "apart")

_FRAMES, _FPS = 300, 30.0
_MOST_SCENES = 1000


@dataclass(frozen=True, slots=True, eq=False)
class Meeting:
    """A scene of several people as each detector sees it; all see the same people."""

    key: str
    scenes: Mapping[str, Scene]  # by detector

    action: ClassVar[str] = "people"
    rig_name: ClassVar[str] = "ring"

    @property
    def subject(self) -> str:
        """The scene."""
        return self.key

    @property
    def first(self) -> Scene:
        """One of the scenes; people, cameras, layout and rate are those of all."""
        return next(iter(self.scenes.values()))

    @property
    def frames(self) -> Index:
        """Frame numbers (T,)."""
        return np.arange(len(self.first.people))

    @property
    def about(self) -> dict[str, Any]:
        """What the index of a written set says of the recording besides its key and cameras."""
        return {"people": len(self.first.truth)}

    def parts(self) -> dict[str, dict[str, Any]]:
        """Return the arrays of each file, apart from the frames."""
        found: dict[str, dict[str, Any]] = {
            f"people_simulated_{detector}": {
                "people": scene.people,
                "owner": scene.owner.astype(np.int16),
                "joint_owner": scene.joint_owner.astype(np.int16),
            }
            for detector, scene in self.scenes.items()
        }
        return {**found, "truth": {"poses": self.first.truth, "visible": self.first.visible}}

    def people(self) -> dict[str, tuple[Array, Mask]]:
        """Return each detector's people (T, M, P, N, 3), and which of them are there (T, M, P)."""
        return {
            detector: (scene.people, np.asarray(np.isfinite(scene.people[..., 0]).any(axis=-1)))
            for detector, scene in self.scenes.items()
        }


def mixed_heights(n_views: int) -> CameraRig:
    """Return a ring of cameras that are 1.2 and 2.6 m high in turn."""
    low, high = (rigs.ring(n_views, radius_mm=RADIUS_MM, height_mm=h) for h in (1200.0, 2600.0))
    return CameraRig([(low, high)[k % 2][k] for k in range(n_views)])


def simulate_people_set(
    people: int = 3, views: int = 4, scenes: int = 5, *, frames: int = _FRAMES, seed: int = 0
) -> RecordingSet[Meeting]:
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
        each = {
            detector: simulate_scene(
                people,
                rig,
                n_frames=frames,
                fps=_FPS,
                meetings=MEETINGS,
                crowding=crowding,
                seed=_MOST_SCENES * seed + k,
            )
            for detector, crowding in CROWDED.items()
        }
        made.append(Meeting(f"scene{k}", each))
    parameters = {
        "seed": seed,
        "people": people,
        "views": views,
        "scenes": scenes,
        "frames": frames,
        "meetings": list(MEETINGS),
        "detectors": {name: asdict(crowding) for name, crowding in CROWDED.items()},
    }
    layout = made[0].first.layout
    return RecordingSet(PEOPLE_SET, layout, {Meeting.rig_name: rig}, tuple(made), parameters, _FPS)
