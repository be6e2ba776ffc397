"""Simulated people who meet: they cross, hand over, circle each other, stand behind each other, leave.

Time is divided into rounds. Each begins and ends with everybody at a place of their own on a circle round the
room; in between, people meet in pairs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from skelsplat._arrays import Array, Index, Mask, generator, positive
from skelsplat.exceptions import InvalidInputError, one_of
from skelsplat.synthetic.motions import stroll

Draw = np.random.Generator

ROOM_MM = 2200.0
"""Radius of the room: nobody's pelvis is farther from its centre, but for bystanders."""

_ROUND_S = 5.0
_HOME = 0.8  # radius of the circle of places, as a share of the room's
_NEAREST_MM = 300.0  # pelvis to pelvis
_GAP_MM = (_NEAREST_MM, 600.0)  # of people who cross
_APART_MM = {"handover": (1000.0, 1150.0), "circle": (500.0, 900.0), "behind": (450.0, 700.0)}
_AWAY_S = (1.0, 2.5)  # absence of somebody who leaves
_SMOOTH_S = 0.25  # half of the window that rounds corners
# Where two meet: so far out from the middle of the room to that of their places, and normal about it.
_INWARD, _SPREAD_MM = 0.6, 250.0
_TRIES = 60  # choreographies of a round that are drawn until nobody else comes too near
_SCALES = (0.9, 1.08)  # of the bodies


@dataclass
class _Part:
    """What two people do in a round, times in s from its middle."""

    at: Array  # (K,)
    way: Array  # (K, 2, 2) mm: where both are then; in between on straight lines
    reach: tuple[float, float] | None = None  # when both stretch out an arm
    face: Array | None = None  # (2, 2) where each looks when they stand; None = at each other
    away: tuple[float, float] | None = None  # when the first is not there


def crowd(
    n_people: int,
    n_frames: int,
    *,
    fps: float = 30.0,
    meetings: Sequence[str] = ("cross", "handover", "circle"),
    eyes: ArrayLike | None = None,
    seed: int | Draw = 0,
) -> Array:
    """Simulate people who meet in a room, (Q, T, 17, 3) mm, Human3.6M-17; NaN while a person is out.

    Pairs of people do one of `meetings`, in turn from a random one, every 5 s. ``"cross"``: they pass at 0.3
    to 0.6 m. ``"handover"``: they meet, reach out and go back. ``"circle"``: they go round each other.
    ``"behind"``: one stands behind the other, seen from a camera whose centre is among `eyes` (M, 3) mm, or
    from anywhere. ``"leave"``: one leaves the room and comes back 1 to 2.5 s later. ``"apart"``: one walks
    about. An odd one out does nothing.
    """
    if n_people < 1 or n_frames < 2:
        raise InvalidInputError(
            f"n_people, n_frames: expected at least 1 and 2, got {n_people!r} and {n_frames!r}"
        )
    positive("fps", fps)
    if not meetings:
        raise InvalidInputError("meetings: expected at least one, got none")
    for kind in meetings:
        one_of("meetings", kind, _MEETINGS)
    rng = generator(seed)
    cameras = np.empty((0, 2)) if eyes is None else np.asarray(eyes, dtype=np.float64)[:, :2]
    steps = np.arange(n_frames) / fps
    plan = _Plan(n_people, steps, rng)
    plan.met = int(rng.integers(len(meetings)))
    for k in range(int(steps[-1] / _ROUND_S) + 1):
        plan.add_round(k * _ROUND_S, meetings, cameras)
    return plan.bodies(fps)


@dataclass
class _Meeting:
    """Where two people meet in a round, what they come from and go to, and how to draw the rest."""

    point: Array  # (2,) mm
    ends: Array  # (2, 2, 2) mm: begin and end of each
    eyes: Array  # (M, 2) mm of the cameras
    rng: Draw


class _Plan:
    """Where everybody is when, drawn round by round."""

    def __init__(self, n_people: int, steps: Array, rng: Draw) -> None:
        self.steps, self.rng = steps, rng
        self.turn = rng.uniform(0.0, 2 * np.pi)
        self.home = rng.permutation(n_people)  # everybody's number on the circle
        self.keys: list[list[_Keys]] = []  # of every round, everybody's
        self.looks = np.zeros((n_people, len(steps), 2))
        self.reach = np.zeros((n_people, len(steps)))
        self.away: Mask = np.zeros((n_people, len(steps)), dtype=bool)
        self.met = 0  # place in the list of meetings

    def place(self, home: int) -> Array:
        angle = self.turn + 2 * np.pi * home / len(self.home)
        return _HOME * ROOM_MM * np.array([np.cos(angle), np.sin(angle)])

    def add_round(self, begin: float, meetings: Sequence[str], eyes: Array) -> None:
        """Draw who meets whom until nobody comes nearer than `_NEAREST_MM`; of many tries take the best."""
        tries = []
        for _ in range(_TRIES):
            tries.append(self.drawn_round(meetings, eyes))
            if self.nearest(tries[-1]) >= _NEAREST_MM - 1.0:
                break
        drawn = max(tries, key=self.nearest)
        middle = begin + _ROUND_S / 2
        self.keys.append([(middle + at, way) for at, way in self.keys_of(drawn)])
        for (a, b), part in drawn[0]:
            self.note(a, b, part, middle)
        self.met += len(drawn[0])
        self.home = drawn[1]

    def drawn_round(self, meetings: Sequence[str], eyes: Array) -> _Round:
        """Draw pairs, what they do, and everybody's next number on the circle."""
        order = self.rng.permutation(len(self.home))
        home = self.home.copy()
        pairs = []
        for k in range(len(order) // 2):
            a, b = int(order[2 * k]), int(order[2 * k + 1])
            kind = meetings[(self.met + k) % len(meetings)]
            if kind in ("cross", "circle"):
                home[[a, b]] = home[[b, a]]
            ends = np.array([[self.place(self.home[q]), self.place(home[q])] for q in (a, b)])
            point = _INWARD * ends.mean(axis=(0, 1)) + self.rng.normal(0.0, _SPREAD_MM, size=2)
            pairs.append(((a, b), _MEETINGS[kind](_Meeting(point, ends, eyes, self.rng))))
        return pairs, home

    def keys_of(self, drawn: _Round) -> list[_Keys]:
        """Where everybody is in a round, and when, from its middle."""
        pairs, home = drawn
        parts = {q: (part.at, part.way[:, k]) for people, part in pairs for k, q in enumerate(people)}
        out = []
        for q in range(len(home)):
            at, way = parts.get(q, (np.empty(0), np.empty((0, 2))))
            ends = [[self.place(self.home[q])], [self.place(home[q])]]
            times = np.concatenate([[-_ROUND_S / 2], at, [_ROUND_S / 2]])
            out.append((times, np.concatenate([ends[0], way, ends[1]])))
        return out

    def nearest(self, drawn: _Round) -> float:
        """Least distance of two people in a round; nobody who is away counts."""
        times = np.arange(-_ROUND_S / 2, _ROUND_S / 2 + 1e-9, 0.1)
        paths = [_path(times, *keys) for keys in self.keys_of(drawn)]
        for (q, _), part in drawn[0]:
            if part.away is not None:
                paths[q][(times > part.away[0]) & (times < part.away[1])] = np.nan
        gaps = [np.linalg.norm(a - b, axis=1) for k, a in enumerate(paths) for b in paths[:k]]
        return float(np.nanmin(gaps)) if gaps else np.inf

    def note(self, a: int, b: int, part: _Part, middle: float) -> None:
        """Keep where two people look, reach, and when one is away."""
        time = self.steps - middle
        during = np.abs(time) < _ROUND_S / 2
        towards = _unit(part.way[len(part.at) // 2, 1] - part.way[len(part.at) // 2, 0])
        self.looks[a, during], self.looks[b, during] = (towards, -towards) if part.face is None else part.face
        if part.reach is not None:
            begin, end = part.reach
            pulse = np.interp(time, [begin, begin + 0.4, end - 0.4, end], [0.0, 1.0, 1.0, 0.0])
            self.reach[[a, b]] += pulse**2 * (3.0 - 2.0 * pulse)
        if part.away is not None:
            self.away[a] |= (time > part.away[0]) & (time < part.away[1])

    def bodies(self, fps: float) -> Array:
        """Return the people's joints (Q, T, 17, 3)."""
        people = []
        for q, keys in enumerate(zip(*self.keys, strict=True)):
            at, way = (np.concatenate(part) for part in zip(*keys, strict=True))
            path = _smoothed(_path(self.steps, at, way), fps)
            velocity = np.gradient(path, axis=0) * fps
            # Who walks looks ahead; who stands looks at somebody.
            ahead = _smoothed(velocity + 150.0 * self.looks[q], fps)
            heading = np.rad2deg(np.unwrap(np.arctan2(ahead[:, 1], ahead[:, 0])))
            heading = _smoothed(heading[:, None], fps)[:, 0]
            scale = self.rng.uniform(*_SCALES)
            pose = stroll(path, heading, fps=fps, reach=self.reach[q], seed=self.rng, scale=scale)
            pose[self.away[q]] = np.nan
            people.append(pose)
        return np.stack(people)


_Round = tuple[list[tuple[tuple[int, int], _Part]], Index]
_Keys = tuple[Array, Array]  # times (K,) s and places (K, 2) mm


def _path(times: Array, at: Array, way: Array) -> Array:
    """Places (T, 2) on the straight lines between the keys."""
    return np.stack([np.interp(times, at, way[:, axis]) for axis in range(2)], axis=1)


def _smoothed(values: Array, fps: float) -> Array:
    """Values (T, D) averaged in a window of two times `_SMOOTH_S`; straight, even motion stays as it is."""
    half = round(_SMOOTH_S * fps)
    window = np.hanning(2 * half + 3)[1:-1]
    padded = np.pad(values, ((half, half), (0, 0)), mode="reflect", reflect_type="odd")
    columns = [np.convolve(column, window / window.sum(), mode="valid") for column in padded.T]
    return np.stack(columns, axis=1)


def _unit(vector: Array) -> Array:
    length = float(np.linalg.norm(vector))
    return vector / length if length > 0 else np.array([1.0, 0.0])


def _cross(meeting: _Meeting) -> _Part:
    """Pass each other, nearest in the middle: there the way from one to the other is across their motion."""
    velocity = (meeting.ends[:, 1] - meeting.ends[:, 0]) / _ROUND_S
    x, y = _unit(velocity[0] - velocity[1])
    aside = meeting.rng.choice([-0.5, 0.5]) * meeting.rng.uniform(*_GAP_MM) * np.array([-y, x])
    at = np.array([-0.4, 0.4])
    return _Part(at, meeting.point + np.array([aside, -aside]) + at[:, None, None] * velocity)


def _handover(meeting: _Meeting) -> _Part:
    """Stand face to face, stretch out an arm, go back."""
    half = _unit(meeting.ends[1, 0] - meeting.ends[0, 0]) * meeting.rng.uniform(*_APART_MM["handover"]) / 2
    way = np.repeat(meeting.point + np.array([[-half, half]]), 2, axis=0)
    return _Part(np.array([-0.8, 0.8]), way, reach=(-0.9, 0.9))


def _circle(meeting: _Meeting) -> _Part:
    """Go round the point between them one and a half times: they change places."""
    begin = _unit(meeting.ends[0, 0] - meeting.ends[1, 0])
    radius, sense = meeting.rng.uniform(*_APART_MM["circle"]) / 2, meeting.rng.choice([-1.0, 1.0])
    at = np.linspace(-1.6, 1.6, 17)
    angle = np.arctan2(begin[1], begin[0]) + sense * 1.5 * 2 * np.pi * (at / 3.2 + 0.5)
    arm = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return _Part(at, meeting.point + np.stack([arm, -arm], axis=1))


def _behind(meeting: _Meeting) -> _Part:
    """Stand in a line with a camera, both looking at it."""
    angle = meeting.rng.uniform(0.0, 2 * np.pi)
    towards = np.array([np.cos(angle), np.sin(angle)])
    if len(meeting.eyes):
        towards = _unit(meeting.rng.choice(meeting.eyes) - meeting.point)
    apart = meeting.rng.uniform(*_APART_MM["behind"])
    way = np.repeat(meeting.point + np.array([[0.0 * towards, -apart * towards]]), 2, axis=0)
    return _Part(np.array([-1.0, 1.0]), way, face=np.stack([towards, towards]))


def _leave(meeting: _Meeting) -> _Part:
    """Go out at the edge of the room and come back: the first; the other walks about."""
    seconds = meeting.rng.uniform(*_AWAY_S)
    at = np.array([-seconds / 2, seconds / 2])
    door = _unit(meeting.ends[0, 0]) * ROOM_MM
    way = np.stack([np.stack([door, door]), np.stack([meeting.point, meeting.point])], axis=1)
    return _Part(at, way, away=(-seconds / 2, seconds / 2))


def _apart(meeting: _Meeting) -> _Part:
    """Walk to the point and back: the first; the other stays."""
    return _Part(np.zeros(1), np.stack([meeting.point, meeting.ends[1, 0]])[None])


_MEETINGS: dict[str, Callable[[_Meeting], _Part]] = {
    "cross": _cross,
    "handover": _handover,
    "circle": _circle,
    "behind": _behind,
    "leave": _leave,
    "apart": _apart,
}

meeting_names: tuple[str, ...] = tuple(_MEETINGS)
"""Names that `crowd` knows."""
