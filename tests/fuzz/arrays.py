"""Odd numbers for every public function: a sound result, or an error that names the argument."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

import skelsplat as sk
from array_forms import CALLS, CONFIDENCE, FORMS, FRAME, LAYOUT, MASKED, PIXELS, POSES, RIG, SEEN
from fuzz.mutate import odd_array
from fuzz.readers import one_line
from skelsplat import synthetic
from skelsplat.association import separate_people
from skelsplat.io import PoseData
from skelsplat.rig_check import check_rig

PEOPLE = np.stack([SEEN, SEEN[::-1]], axis=2)
# Arithmetic with numbers of 1e308 may overflow, and NumPy say so.
WARNINGS = "ignore"
_NUMBERS = (0, 1, 2, -1, 2**31, 2**64, 0.5, 1e-320, 1e-12, 1e12, 1e308, -1.0, np.nan, np.inf)
_VALUES = (None, True, "x", [], [1.0], *_NUMBERS)


def _adjusted(detections: Any, confidence: Any) -> Any:
    return sk.adjust_cameras(detections, RIG, confidence=confidence, focal=True, clock=True)


def _stepped(detections: Any, fps: Any) -> Any:
    refiner = sk.Refiner(RIG, layout=LAYOUT, fps=fps, lag=1)
    return [refiner.step(frame) for frame in _each(detections)]


def _tracked(people: Any, fps: Any) -> Any:
    tracker = sk.Tracker(RIG, layout=LAYOUT, fps=fps)
    return [person for frame in _each(people) for person in tracker.step(frame)]


def _each(values: Any) -> Any:
    return values if isinstance(values, list | np.ndarray) and np.ndim(values) else [values]


def _turned(K: Any, R: Any, t: Any, distortion: Any, size: Any) -> Any:
    """One odd camera among others: made, looked through, and used."""
    camera = sk.Camera(K, R, t, distortion=distortion, size=size, name="odd")
    rig = [camera, *list(RIG)[1:]]
    there = sk.project(POSES[0], rig)
    return camera, camera.undistort(there[0]), sk.refine(None, FRAME, rig, layout=LAYOUT)


_BOTH = {"detections": PIXELS, "confidence": CONFIDENCE}
ODD = {"K": RIG[0].K, "R": RIG[0].R, "t": RIG[0].t, "distortion": np.array([-0.2, 0.1, 1e-3, 1e-3, 0.01])}
MORE: dict[str, tuple[Callable[..., Any], dict[str, Any]]] = {
    "refine a batch": (
        lambda init_pose, **given: sk.refine(init_pose, cameras=RIG, layout=LAYOUT, **given),
        {"init_pose": POSES, **_BOTH},
    ),
    "refine_sequence": (
        lambda fps, **given: sk.refine_sequence(cameras=RIG, layout=LAYOUT, fps=fps, **given),
        {"fps": 50.0, **_BOTH},
    ),
    "adjust_cameras": (_adjusted, _BOTH),
    "Refiner with a rate": (_stepped, {"detections": SEEN, "fps": 50.0}),
    "track": (
        lambda people, fps: sk.track(people, RIG, layout=LAYOUT, fps=fps),
        {"people": PEOPLE, "fps": 50.0},
    ),
    "Tracker": (_tracked, {"people": PEOPLE, "fps": 50.0}),
    "separate_people": (lambda people: separate_people(people, RIG), {"people": PEOPLE}),
    "joint_angles": (
        lambda pose, up: sk.joint_angles(pose, layout=LAYOUT, up=up),
        {"pose": POSES, "up": np.array([0, 0, 1.0])},
    ),
    "check_rig": (lambda people: check_rig(RIG, people, layout=LAYOUT), {"people": PEOPLE}),
    "an odd camera": (_turned, {**ODD, "size": np.array(RIG[0].size)}),
    "motion": (lambda seed: synthetic.motion("walk", 3, seed=seed), {"seed": np.array(3)}),
}
EVERYTHING = {**CALLS, **MORE}


def case(rng: Random, folder: Path) -> tuple[str, Callable[[], str]]:
    """Return a call with one or two odd arguments."""
    name = rng.choice(list(EVERYTHING))
    function, arrays = EVERYTHING[name]
    odd = {
        key: odd_argument(rng, arrays[key])
        for key in rng.sample(list(arrays), rng.choice((1, 1, len(arrays))))
    }
    (folder / "arguments.txt").write_text(repr(odd), encoding="utf-8", errors="backslashreplace")
    return f"{name}: {', '.join(odd)}", lambda: tried(function, {**arrays, **odd})


def odd_argument(rng: Random, value: Any) -> Any:
    """Return numbers with other values, or of another shape, type or form."""
    array = np.asarray(value)
    choice = rng.random()
    if choice < 0.05:
        return rng.choice(_VALUES)
    for _ in range(rng.choice((1, 1, 2))):
        array = odd_array(rng, array)
    if array.dtype.kind in "fiu" and choice < 0.3:
        form = rng.choice(list(FORMS))
        return FORMS[form](array)
    if array.dtype.kind == "f" and choice < 0.4:
        hidden = np.random.default_rng(rng.randrange(2**32)).random(array.shape) < rng.choice((0.1, 0.9, 1.0))
        return rng.choice(list(MASKED.values()))(array, hidden) if array.ndim else array
    return array


def tried(function: Callable[..., Any], given: dict[str, Any]) -> str:
    """Call, and return what came of it; raise for anything but a sound result or a proper error."""
    try:
        result = function(**given)
    except sk.InvalidInputError as error:
        return one_line(error, starts_with=error.argument if error.reason else "an argument")
    except (sk.DegenerateGeometryError, MemoryError) as error:
        return one_line(error)
    for refinement in refinements(result):
        check(refinement)
    return "answered"


def refinements(value: Any) -> Iterator[sk.Refinement]:
    """Every refinement in a result."""
    if isinstance(value, sk.Refinement):
        yield value
    elif isinstance(value, tuple | list):
        for inner in value:
            yield from refinements(inner)
    elif dataclasses.is_dataclass(value) and not isinstance(value, PoseData):
        for field in dataclasses.fields(value):
            yield from refinements(getattr(value, field.name))


def check(result: sk.Refinement) -> None:
    """Raise unless joints that are ok are somewhere, with error bars that are positive definite."""
    ok = result.joint_status == "ok"
    sure = ok | (result.joint_status == "inferred")  # a weak one may be nowhere: seen by one view alone
    assert np.isfinite(result.pose[sure]).all(), "a joint that is ok or inferred is nowhere"
    nothing = result.stop_reason == "no_observations"
    assert (np.isfinite(result.noise) | nothing).all(), "no noise where something is seen"
    assert not np.isinf(result.pose).any(), "an infinite joint"
    for name in ("uncertainty", "error_bar"):
        bars = getattr(result, name)[ok]
        assert np.isfinite(bars).all(), f"{name} of a joint that is ok is not finite"
        if len(bars):
            scale = np.abs(bars).max(axis=(-2, -1))
            assert (scale > 0).all(), f"{name} of 0"
            assert (np.linalg.eigvalsh(bars / scale[:, None, None])[:, 0] > 0).all(), (
                f"{name} not positive definite"
            )
    weights = result.view_weights
    assert ((weights >= 0) & (weights <= 1) | np.isnan(weights)).all(), "a weight beyond [0, 1]"
