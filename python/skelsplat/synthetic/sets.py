"""Simulated data sets that resemble the ones of the literature in rig, layout, actions and numbers.

Nothing in them was seen by a camera: poses are the package's motions, detections those of
`skelsplat.synthetic.noise`. They stand in for data sets that may not be passed on, and their results are
results on simulated detections.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from skelsplat import layouts
from skelsplat._arrays import Array, corners
from skelsplat._skelsplat import Camera, Layout
from skelsplat.cameras import CameraRig
from skelsplat.exceptions import InvalidInputError, one_of
from skelsplat.synthetic import rigs
from skelsplat.synthetic.crowding import Crowding
from skelsplat.synthetic.crowds import meeting_names
from skelsplat.synthetic.detections import corrupt, draw_occluders, true_pixels
from skelsplat.synthetic.motions import motion, motion_names
from skelsplat.synthetic.noise import SIZE_IN_ROOM, DetectionNoise, monocular_poses, stream
from skelsplat.synthetic.scenes import Scene, simulate_scene
from skelsplat.synthetic.skeleton import in_layout

# HD cameras of CMU Panoptic in the order in which the experiments add them.
PANOPTIC_CAMERAS = (1, 2, 10, 13, 3, 23, 19, 30)
# Raised whenever the same name, number and seed give other data than before.
GENERATOR_VERSION = 1
# Error per axis of the simulated monocular poses; their fusion then errs 40 mm (mean per joint, 4 views).
MONOCULAR_SIGMA_MM = 62.0
# What the random streams of a recording are for. Occluders and detectors do not change the poses.
_POSES, _OCCLUDERS, _MONOCULAR, _FIRST_DETECTOR = range(4)
# Boxes are drawn this much wider than the joints, as a share of their extent on each side.
_BOX_MARGIN = 0.1

_CAPTURE_HZ = 50.0
# Detectors, a good one and one that jitters more and misses joints, for a room like Human3.6M's. A detector
# errs in proportion to the person's size in the image, so elsewhere its pixels are scaled.
_DETECTORS = {"good": DetectionNoise.good(), "noisy": DetectionNoise.noisy()}

# Subject → body size, as a factor on the 1.75 m adult, poses in all, and those of some takes: the takes that
# the absolute error leaves out, and S11 "Directions". These are the numbers of Human3.6M at every 64th frame;
# the other takes share the rest evenly.
_SUBJECTS: dict[str, tuple[float, int, dict[str, int]]] = {
    "S9": (1.02, 1253, {"SittingDown 1": 25, "Waiting 1": 26, "Greeting": 23}),
    "S11": (0.97, 928, {"Directions": 29}),
}

# Action → the package's motion that stands in for it.
_MOTIONS = {
    "Directions": "reach",
    "Discussion": "wave",
    "Eating": "sit",
    "Greeting": "wave",
    "Phoning": "turn",
    "Photo": "reach",
    "Posing": "turn",
    "Purchases": "crouch",
    "Sitting": "sit",
    "SittingDown": "crouch",
    "Smoking": "sit",
    "Waiting": "turn",
    "WalkDog": "walk",
    "WalkTogether": "walk",
    "Walking": "walk",
}


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """One take of T frames.

    `key` is unique and may contain a slash: ``"S9/Directions 1"``; `action` has no number. `arrays` has the
    arrays of ``"truth"``, ``"detections_simulated_good"``, … by their keys, as `skelsplat synth` writes them
    and docs/synthetic-data.md describes them. `people` is how many meet in it, if it is not of one person.
    """

    key: str
    subject: str
    action: str
    rig_name: str
    frames: NDArray[np.int64]
    arrays: Mapping[str, Mapping[str, NDArray[Any]]] = field(repr=False)
    people: int | None = None


@dataclass(frozen=True, slots=True, eq=False)
class RecordingSet:
    """Recordings that share a layout and detectors.

    `parameters` is all that the data follow from, for people to read; `fps` is None if the frames are single
    poses.
    """

    name: str
    layout: Layout
    rigs: Mapping[str, CameraRig]
    recordings: tuple[Recording, ...]
    parameters: Mapping[str, Any]
    fps: float | None = None


@dataclass(frozen=True)
class _Take:
    """What is simulated: a motion sampled `count` times, every `step` frames at 50 Hz."""

    key: str
    subject: str
    action: str
    motion: str
    rig: str
    count: int
    step: int
    scale: float


def _human_takes(subject: str) -> list[_Take]:
    """Return a subject's takes: every action, and again with `` 1`` after its name."""
    names = [(action, f"{action}{number}") for action in _MOTIONS for number in ("", " 1")]
    scale, total, known = _SUBJECTS[subject]
    rest, n_rest = total - sum(known.values()), len(names) - len(known)
    # The remainder of the division goes to the first takes, one pose each.
    shares = iter([rest // n_rest + (k < rest % n_rest) for k in range(n_rest)])
    return [
        _Take(
            f"{subject}/{name}",
            subject,
            action,
            _MOTIONS[action],
            "room",
            known[name] if name in known else next(shares),
            64,
            scale,
        )
        for action, name in names
    ]


def simulate_set(name: str, *, poses: int | None = None, seed: int = 0) -> RecordingSet:
    """Simulate a data set, one of `set_names`: same name, number and seed, same data.

    `poses` is their number over all takes, at least one per take; each set has its own default. The sets
    ``human36m-like…`` of one seed have the same poses.
    """
    one_of("name", name, _SETS)
    if seed < 0:
        raise InvalidInputError(f"seed: expected an integer >= 0, got {seed!r}")
    make, occluders = _SETS[name]
    takes, places, layout, size = make(seed)
    counts = _share(poses, [take.count for take in takes])
    takes = [replace(take, count=count) for take, count in zip(takes, counts, strict=True)]
    copied = ("occluded_views", "n_discs", "disc_radius", "hidden_missing_rate")
    shared: dict[str, Any] = {key: getattr(occluders, key) for key in copied}
    scaled = {key: noise.scaled(size / SIZE_IN_ROOM) for key, noise in _DETECTORS.items()}
    detectors = {key: replace(noise, **shared) for key, noise in scaled.items()}
    recordings = tuple(
        _recording(take, places[take.rig], layout, detectors, (seed, k)) for k, take in enumerate(takes)
    )
    parameters = {
        "generator_version": GENERATOR_VERSION,
        "seed": seed,
        "poses": sum(counts),
        "detectors": {key: asdict(noise) for key, noise in detectors.items()},
        "monocular_sigma_mm": MONOCULAR_SIGMA_MM,
        "motions": {take.key: take.motion for take in takes},
    }
    return RecordingSet(name, layout, places, recordings, parameters)


_Made: TypeAlias = tuple[list[_Take], dict[str, CameraRig], Layout, float]
"""Takes, rigs, joints, and the size of people in the images."""


def _human36m(_: int) -> _Made:
    """S9 and S11, fifteen actions twice each, four cameras with lens distortion, every 64th frame."""
    takes = [take for subject in _SUBJECTS for take in _human_takes(subject)]
    return takes, {"room": rigs.human36m_like(distortion=True)}, layouts.H36M17, SIZE_IN_ROOM


def _dome(_: int) -> _Made:
    """Two sequences of one person each in the eight cameras of a dome that the experiments use."""
    # The first cameras of `rigs.dome` are spread out best; the names are those of Panoptic.
    named = zip(rigs.dome(len(PANOPTIC_CAMERAS)), PANOPTIC_CAMERAS, strict=True)
    cameras = [Camera(c.K, c.R, c.t, size=c.size, name=f"00_{number:02d}") for c, number in named]
    takes = [
        _Take(f"{sequence}/{kind}", "S0", sequence, kind, "dome", 100, 32, scale)
        for sequence, scale in (("pose1", 1.0), ("pose2", 0.95))
        for kind in motion_names
    ]
    return takes, {"dome": CameraRig(cameras)}, layouts.PANOPTIC19, 1400.0 / 2800.0


def _occlusion_person(seed: int) -> _Made:
    """Nine scenes with a ring of eight cameras each, large occluders in every view, no joint missing."""
    draw = stream(seed, 999)
    places = {f"scene{k}": rigs.ring(radius_mm=draw.uniform(3000.0, 4200.0)) for k in range(1, 10)}
    scales = draw.uniform(0.9, 1.08, size=9).tolist()
    takes = [
        _Take(f"S0/{scene}", "S0", scene, motion_names[k % len(motion_names)], scene, 120, 50, scales[k])
        for k, scene in enumerate(places)
    ]
    return takes, places, layouts.OCCLUSION_PERSON15, 640.0 / 3600.0


def _recording(
    take: _Take,
    rig: CameraRig,
    layout: Layout,
    detectors: Mapping[str, DetectionNoise],
    seeds: tuple[int, ...],
) -> Recording:
    """Simulate what is recorded of a take. All detectors see the same occluders: those of the first one."""
    body = motion(
        take.motion, take.count, fps=_CAPTURE_HZ / take.step, seed=stream(*seeds, _POSES), scale=take.scale
    )
    truth = in_layout(body, layout)
    pixels = true_pixels(truth, rig)
    first = next(iter(detectors.values()))
    occluders = draw_occluders(pixels, first, stream(*seeds, _OCCLUDERS))
    arrays: dict[str, dict[str, NDArray[Any]]] = {"truth": {"poses": truth, "boxes": _boxes(pixels)}}
    if first.occluded_views != 0:
        arrays["truth"]["visible"] = np.isfinite(pixels).all(axis=-1) & ~occluders.hidden(pixels)
    poses = monocular_poses(truth, rig, MONOCULAR_SIGMA_MM, seed=stream(*seeds, _MONOCULAR))
    arrays["monocular_simulated"] = {"poses": poses}
    for k, (name, noise) in enumerate(detectors.items()):
        found = corrupt(pixels, noise, layout, stream(*seeds, _FIRST_DETECTOR + k), occluders)
        arrays[f"detections_simulated_{name}"] = {"detections": found}
    frames = take.step * np.arange(take.count, dtype=np.int64)
    return Recording(take.key, take.subject, take.action, take.rig, frames, arrays)


def _boxes(pixels: Array) -> Array:
    """Boxes (T, M, 4) round the joints (T, M, N, 2) in the image, with a margin."""
    low, high = corners(pixels)
    low, high = (np.where(low <= high, edge, np.nan) for edge in (low, high))
    margin = _BOX_MARGIN * (high - low)
    return np.concatenate([low - margin, high + margin], axis=-1)


def _share(total: int | None, defaults: Sequence[int]) -> list[int]:
    """Numbers of poses per take that add up to `total`: one each, the rest in proportion to `defaults`."""
    if total is None:
        return list(defaults)
    if total < len(defaults):
        raise InvalidInputError(f"poses: expected at least {len(defaults)} (one per take), got {total}")
    exact = np.asarray(defaults) * (total - len(defaults)) / sum(defaults)
    counts = np.floor(exact).astype(int)
    largest = np.argsort(counts - exact, kind="stable")[: total - len(defaults) - counts.sum()]
    counts[largest] += 1
    return [int(count) + 1 for count in counts]


_SETS: dict[str, tuple[Callable[[int], _Made], DetectionNoise]] = {
    "human36m-like": (_human36m, DetectionNoise()),
    "human36m-like-occ-2": (_human36m, DetectionNoise.occluded(2)),
    "human36m-like-occ-3": (_human36m, DetectionNoise.occluded(3)),
    "human36m-like-occ-3-hard": (_human36m, DetectionNoise.occluded(3, hard=True)),
    "dome": (_dome, DetectionNoise()),
    "occlusion-person-like": (
        _occlusion_person,
        DetectionNoise(occluded_views=None, n_discs=2, disc_radius=(0.06, 0.22)),
    ),
}
"""What is in each set, and the occluders in front of it."""

set_names: tuple[str, ...] = tuple(_SETS)
"""Names that `simulate_set` knows."""

PEOPLE_SET = "people"  # name of the set of several people
# Detectors: what each does wrong because several people are there. Of one person alone they are the same.
_CROWDED = {"good": Crowding(), "noisy": Crowding.heavy()}
_MEETINGS = tuple(name for name in meeting_names if name != "apart")
_RIG = "ring"
_FRAMES, _FPS = 300, 30.0
_MOST_SCENES = 1000


def simulate_people_set(
    people: int = 3, views: int = 4, scenes: int = 5, *, frames: int = _FRAMES, seed: int = 0
) -> RecordingSet:
    """Simulate scenes of several people, as `simulate_scene` does, at 30 Hz.

    2 to 6 people, 3 to 8 cameras, 1 to 1000 scenes of so many frames. Scene k of seed S is that of
    ``simulate_scene(…, seed=1000 * S + k)``.
    """
    limits = {
        "people": (people, 2, 6),
        "views": (views, 3, 8),
        "scenes": (scenes, 1, _MOST_SCENES),
        "frames": (frames, 2, np.inf),
        "seed": (seed, 0, np.inf),
    }
    for name, (value, least, most) in limits.items():
        if not least <= value <= most:
            raise InvalidInputError(f"{name}: expected an integer from {least} to {most}, got {value!r}")
    rig, made = rigs.mixed_heights(views), []
    for k in range(scenes):
        scene_of = partial(simulate_scene, people, rig, n_frames=frames, fps=_FPS, meetings=_MEETINGS)
        seen = {
            detector: scene_of(crowding=crowding, seed=_MOST_SCENES * seed + k)
            for detector, crowding in _CROWDED.items()
        }
        made.append(_meeting(f"scene{k}", seen))
    parameters = {
        "seed": seed,
        "people": people,
        "views": views,
        "scenes": scenes,
        "frames": frames,
        "meetings": list(_MEETINGS),
        "detectors": {name: asdict(crowding) for name, crowding in _CROWDED.items()},
    }
    return RecordingSet(PEOPLE_SET, layouts.H36M17, {_RIG: rig}, tuple(made), parameters, _FPS)


def _meeting(key: str, seen: Mapping[str, Scene]) -> Recording:
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
