"""Simulated motions of the articulated skeleton: walk, sit, reach, crouch, wave, turn.

Each motion is a set of joint-angle curves over time, repeated with a natural period; `seed` picks the
person's habits (amplitudes, speeds, side), place, heading and the moment at which the clip starts.
World: mm, z up, floor z = 0.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from skelsplat._arrays import Array, generator, positive
from skelsplat.exceptions import InvalidInputError, one_of
from skelsplat.synthetic.skeleton import ANKLE_HEIGHT_MM, JOINT_NAMES, LIMITS_DEG, forward_kinematics

_LEG_MM = 885.0
_ANKLES = [JOINT_NAMES.index("left_ankle"), JOINT_NAMES.index("right_ankle")]
# Length over which support passes from one foot to the other when the body is set on the floor.
_SUPPORT_BLEND_MM = 8.0


@dataclass
class _Script:
    """What a motion prescribes; the feet and the floor then decide where the body is."""

    angles: dict[str, Array]
    heading_deg: Array
    path: Array | None = None
    """Pelvis (T, 2) mm; None = the feet stay where they are."""


def _smooth_cycle(seconds: Array, rise: float, hold: float, fall: float, rest: float) -> Array:
    """0 → 1 in `rise` s, 1 for `hold` s, → 0 in `fall` s, 0 for `rest` s, repeated; smooth acceleration."""
    edges = np.cumsum([0.0, rise, hold, fall, rest])
    ramp = np.interp(seconds % edges[-1], edges, [0.0, 1.0, 1.0, 0.0, 0.0])
    smooth: Array = ramp**3 * (10.0 - 15.0 * ramp + 6.0 * ramp**2)
    return smooth


def _sway(seconds: Array, amplitude: float, rng: np.random.Generator) -> Array:
    """Slow random movement: three sines of 0.15 to 0.6 Hz with a total RMS of `amplitude`."""
    frequency = rng.uniform(0.15, 0.6, size=3)
    phase = rng.uniform(0.0, 2 * np.pi, size=3)
    waves = np.sin(2 * np.pi * frequency * seconds[:, None] + phase)
    total: Array = amplitude * np.sqrt(2.0 / 3.0) * waves.sum(axis=-1)
    return total


def _stand(seconds: Array, rng: np.random.Generator) -> dict[str, Array]:
    """Angles of somebody who stands at ease; every motion starts from these."""
    rest = {
        "spine_flexion": rng.uniform(2.0, 8.0),
        "neck_flexion": rng.uniform(-5.0, 15.0),
        "neck_rotation": rng.uniform(-10.0, 10.0),
    }
    for side in "lr":
        rest |= {
            f"shoulder_flexion_{side}": rng.uniform(-5.0, 15.0),
            f"shoulder_abduction_{side}": rng.uniform(6.0, 16.0),
            f"elbow_flexion_{side}": rng.uniform(12.0, 35.0),
            f"hip_abduction_{side}": rng.uniform(2.0, 7.0),
            f"knee_flexion_{side}": 6.0,
            f"hip_flexion_{side}": 3.0,
        }
    still = ("hip", "knee")
    return {
        name: value + (0.0 if name.startswith(still) else 1.0) * _sway(seconds, 1.5, rng)
        for name, value in rest.items()
    }


def _add(angles: dict[str, Array], name: str, value: Array) -> None:
    """Add to an angle on both sides."""
    for side in "lr":
        angles[f"{name}_{side}"] = angles[f"{name}_{side}"] + value


def _towards(angles: dict[str, Array], name: str, value: Array | float, share: Array | float) -> None:
    """Move an angle by a share of the way to a value, in place."""
    angles[name] = np.asarray((1.0 - share) * angles.get(name, 0.0) + share * value)


def _walk(seconds: Array, rng: np.random.Generator) -> _Script:
    """Walk round a circle of 1.0 to 1.5 m at the speed that the stride gives."""
    angles = _stand(seconds, rng)
    swing = rng.uniform(18.0, 26.0)
    period = rng.uniform(1.0, 1.3)
    _stride(angles, 2 * np.pi * seconds / period, swing, arm_swing=rng.uniform(12.0, 28.0))
    angles["lean"] = np.full_like(seconds, rng.uniform(2.0, 6.0))
    speed = 4.0 * _LEG_MM * np.sin(np.deg2rad(swing)) / period
    radius, turn = rng.uniform(1000.0, 1500.0), rng.choice([-1.0, 1.0])
    around = rng.uniform(0.0, 2 * np.pi) + turn * speed * seconds / radius
    path = radius * np.stack([np.cos(around), np.sin(around)], axis=-1)
    return _Script(angles, np.rad2deg(around) + 90.0 * turn, path)


def _stride(
    angles: dict[str, Array], phase: Array, swing: float, arm_swing: float, share: Array | float = 1.0
) -> None:
    """Set legs, arms and spine to a phase of walking, in place; with `share` 0 they stay as they are."""
    walking = {"spine_rotation": -5.0 * np.cos(phase)}
    for side, shift in (("l", 0.0), ("r", np.pi)):
        leg = phase + shift
        walking[f"hip_flexion_{side}"] = 6.0 + swing * np.cos(leg)
        # The knee bends most just before the leg passes under the body on its way forward.
        walking[f"knee_flexion_{side}"] = 6.0 + 52.0 * np.exp(3.0 * (np.cos(leg - 1.4 * np.pi) - 1.0))
        walking[f"hip_abduction_{side}"] = np.zeros_like(phase)
        walking[f"shoulder_flexion_{side}"] = 2.0 - arm_swing * np.cos(leg)
    for name, value in walking.items():
        _towards(angles, name, value, share)


def _sit(seconds: Array, rng: np.random.Generator) -> _Script:
    """Sit down on a chair, stay, get up."""
    angles = _stand(seconds, rng)
    down = _smooth_cycle(seconds, rng.uniform(1.0, 1.6), rng.uniform(2.0, 3.5), 1.2, rng.uniform(0.6, 1.2))
    flexed = rng.uniform(80.0, 92.0)
    _add(angles, "hip_flexion", down * flexed)
    _add(angles, "knee_flexion", down * (flexed + rng.uniform(-4.0, 6.0)))
    # The trunk comes forward on the way and is nearly upright at both ends.
    angles["spine_flexion"] = angles["spine_flexion"] + 30.0 * 4.0 * down * (1.0 - down) + 8.0 * down
    on_lap = rng.uniform(20.0, 40.0)
    _add(angles, "shoulder_flexion", down * on_lap)
    _add(angles, "elbow_flexion", down * on_lap)
    return _Script(angles, _heading(seconds, rng))


def _crouch(seconds: Array, rng: np.random.Generator) -> _Script:
    """Go down into a squat, feet in place, and come up."""
    angles = _stand(seconds, rng)
    down = _smooth_cycle(seconds, rng.uniform(0.8, 1.3), rng.uniform(1.0, 2.0), 1.0, rng.uniform(0.6, 1.2))
    knee = rng.uniform(105.0, 130.0)
    _add(angles, "hip_flexion", down * rng.uniform(88.0, 105.0))
    _add(angles, "knee_flexion", down * knee)
    angles["lean"] = down * rng.uniform(10.0, 18.0)
    angles["spine_flexion"] = angles["spine_flexion"] + down * rng.uniform(15.0, 30.0)
    for side in "lr":
        forward = down * rng.uniform(30.0, 70.0)
        angles[f"shoulder_flexion_{side}"] = angles[f"shoulder_flexion_{side}"] + forward
    return _Script(angles, _heading(seconds, rng))


def _reach(seconds: Array, rng: np.random.Generator) -> _Script:
    """Stretch one arm out toward changing places in front of the body and take it back."""
    angles = _stand(seconds, rng)
    cycle = (rng.uniform(0.7, 1.0), rng.uniform(0.3, 0.7), 0.8, rng.uniform(0.3, 0.6))
    out = _smooth_cycle(seconds, *cycle)
    side, turn = ("l", -1.0) if rng.random() < 0.5 else ("r", 1.0)
    # Each stretch has its own height, chosen while the arm is down.
    heights = rng.uniform(60.0, 120.0, size=64)
    height = heights[(seconds // sum(cycle)).astype(int) % len(heights)]
    _towards(angles, f"shoulder_flexion_{side}", height, out)
    _towards(angles, f"elbow_flexion_{side}", 8.0, out)
    angles["spine_flexion"] = angles["spine_flexion"] + out * rng.uniform(10.0, 30.0)
    angles["spine_rotation"] = turn * out * rng.uniform(5.0, 25.0)
    return _Script(angles, _heading(seconds, rng))


def _wave(seconds: Array, rng: np.random.Generator) -> _Script:
    """Raise one arm, wave with the forearm, lower it."""
    angles = _stand(seconds, rng)
    up = _smooth_cycle(seconds, 0.7, rng.uniform(2.5, 4.0), 0.7, rng.uniform(0.4, 0.8))
    side = "l" if rng.random() < 0.5 else "r"
    swing = rng.uniform(18.0, 30.0) * np.sin(2 * np.pi * rng.uniform(1.2, 2.0) * seconds)
    raised: dict[str, float | Array] = {
        "shoulder_abduction": rng.uniform(90.0, 130.0),
        "shoulder_flexion": 5.0,
        "shoulder_rotation": rng.uniform(52.0, 60.0) + swing,
        "elbow_flexion": rng.uniform(55.0, 80.0),
    }
    for name, value in raised.items():
        _towards(angles, f"{name}_{side}", value, up)
    return _Script(angles, _heading(seconds, rng))


def _turn(seconds: Array, rng: np.random.Generator) -> _Script:
    """Turn on the spot by 90° to 180° with small steps, wait, turn back."""
    angles = _stand(seconds, rng)
    duration = rng.uniform(1.2, 2.0)
    turned = _smooth_cycle(seconds, duration, rng.uniform(0.6, 1.2), duration, rng.uniform(0.6, 1.2))
    moving = 4.0 * turned * (1.0 - turned)
    step = 2 * np.pi * seconds / rng.uniform(0.7, 0.9)
    for side, shift in (("l", 0.0), ("r", np.pi)):
        lift = moving * 0.5 * (1.0 + np.cos(step + shift))
        angles[f"hip_flexion_{side}"] = angles[f"hip_flexion_{side}"] + 22.0 * lift
        angles[f"knee_flexion_{side}"] = angles[f"knee_flexion_{side}"] + 42.0 * lift
    way = rng.choice([-1.0, 1.0])
    # The head goes first: it is ahead of the body while the body turns.
    angles["neck_rotation"] = angles["neck_rotation"] + way * 25.0 * moving
    return _Script(angles, _heading(seconds, rng) + way * rng.uniform(90.0, 180.0) * turned)


def _heading(seconds: Array, rng: np.random.Generator) -> Array:
    """Constant direction chosen at random, degrees."""
    return np.full_like(seconds, rng.uniform(0.0, 360.0))


# Slower than this, mm/s, a stride is shorter than the speed would give, until the person stands.
_STROLL_MM_S = 500.0


def stroll(
    path: Array,
    heading_deg: Array,
    *,
    fps: float,
    reach: Array | float = 0.0,
    seed: int | np.random.Generator = 0,
    scale: float = 1.0,
) -> Array:
    """Simulate a person who walks along a smooth path (T, 2) mm, stands where it stops, and reaches out.

    `heading_deg` (T,) is counter-clockwise from +x; `reach` (T,) is how far one arm is out, 0 to 1. Returns
    (T, 17, 3) mm, Human3.6M-17.
    """
    rng = generator(seed)
    angles = _stand(rng.uniform(0.0, 8.0) + np.arange(len(path)) / fps, rng)
    swing, arm_swing = rng.uniform(18.0, 26.0), rng.uniform(12.0, 28.0)
    speed = np.linalg.norm(np.gradient(path, axis=0), axis=1) * fps
    share = np.minimum(speed / (scale * _STROLL_MM_S), 1.0)
    length = 4.0 * scale * _LEG_MM * np.sin(np.deg2rad(swing))
    phase = 2 * np.pi * (rng.random() + np.cumsum(speed) / fps / length)
    _stride(angles, phase, swing, arm_swing, share)
    angles["lean"] = share * rng.uniform(2.0, 6.0)
    side = "l" if rng.random() < 0.5 else "r"
    for name, value in (("shoulder_flexion", rng.uniform(70.0, 90.0)), ("elbow_flexion", 8.0)):
        angles[f"{name}_{side}"] = (1.0 - reach) * angles[f"{name}_{side}"] + reach * value
    return _performed(_Script(angles, heading_deg, path), path, scale)


_MOTIONS: dict[str, Callable[[Array, np.random.Generator], _Script]] = {
    "walk": _walk,
    "sit": _sit,
    "reach": _reach,
    "crouch": _crouch,
    "wave": _wave,
    "turn": _turn,
}

motion_names: tuple[str, ...] = tuple(_MOTIONS)
"""Names that `motion` knows."""


def _performed(script: _Script, place: Array, scale: float) -> Array:
    """Move the body, on the floor, with the pelvis on its path or the feet's middle at `place` (2,) mm."""
    # Sway may carry an angle a degree past its limit.
    angles = {key: np.clip(value, *LIMITS_DEG[key]) for key, value in script.angles.items()}
    heading, n_frames = script.heading_deg, len(script.heading_deg)
    pose = forward_kinematics(angles, heading, n_frames=n_frames, scale=scale)
    anchor = pose[:, _ANKLES, :2].mean(axis=1) if script.path is None else pose[:, 0, :2]
    goal: Array = place if script.path is None else script.path
    heights = pose[:, _ANKLES, 2]
    low = heights.min(axis=1)
    # Soft minimum: the support passes smoothly from foot to foot.
    blend = scale * _SUPPORT_BLEND_MM
    ground = low - blend * np.log(np.exp(-(heights - low[:, None]) / blend).sum(axis=1) / 2.0)
    shift = np.concatenate([goal - anchor, (scale * ANKLE_HEIGHT_MM - ground)[:, None]], axis=1)
    placed: Array = pose + shift[:, None, :]
    return placed


def motion(
    name: str, n_frames: int, *, fps: float = 50.0, seed: int | np.random.Generator = 0, scale: float = 1.0
) -> Array:
    """Simulate a clip (T, 17, 3) mm of one person, Human3.6M-17, z up, floor at z = 0.

    `name` is one of `motion_names`; one round of it takes 1 s (a stride) to 7 s (sit and get up). A longer
    clip of the same seed starts with the shorter one. The person stays within 2 m of the origin; `scale` is a
    factor on the 1.75 m adult, place and path.
    """
    one_of("name", name, _MOTIONS)
    if n_frames < 1:
        raise InvalidInputError(f"n_frames: expected at least 1, got {n_frames!r}")
    positive("fps", fps)
    positive("scale", scale)
    rng = generator(seed)
    seconds = rng.uniform(0.0, 8.0) + np.arange(n_frames) / fps
    place = scale * rng.uniform(-500.0, 500.0, size=2)
    script = _MOTIONS[name](seconds, rng)
    if script.path is not None:
        script.path = scale * script.path
    return _performed(script, place, scale)
