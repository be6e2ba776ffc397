"""``track`` and ``Tracker``: several people. All computation is in the compiled core."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike

from skelsplat import _skelsplat
from skelsplat._arrays import Array, Index, numbers, positive, take_people
from skelsplat._frozen import of_new_images
from skelsplat._refine import Cameras, Progress, Refinement, refinement_fields, reporter, warn_of_size
from skelsplat._sequence import SequenceRefinement
from skelsplat._skelsplat import Layout, RefineConfig
from skelsplat._words import length, listed, percent
from skelsplat.cameras import mm_per_unit
from skelsplat.exceptions import InvalidInputError
from skelsplat.findings import Finding, Remedy, Subject, warn

# Time in which views detect people and nobody is found, after which something must be wrong, s.
_IN_VAIN_S = 2.0
# Nobody's left and right limbs differ by more: joints are in another order than the layout states.
_LIMB_RATIO = 1.5
# Part of the people whom two cameras should share, but each sees others, from which they contradict each
# other, and below which they agree: sound cameras have 0.1 in crowds, 0.5 is a coin.
_CONTRARY, _AGREE = 0.5, 0.2
# Fewer frames may be chance.
_LEAST_FRAMES = 10

#: People per view: an array, or per frame a list of views with the people (P_i, N, 2|3) of each, or None.
People = ArrayLike | Sequence[Sequence[ArrayLike | None]]


@dataclass(frozen=True, slots=True)
class Person:
    """One person of a recording, or of a frame of a live loop.

    ``id`` counts from 0 in the order of appearance; a person out of sight is lost after one second and keeps
    it for five more if place and bones allow. ``frames`` (F,) are those of the recording from the first to
    the last in which two views see the person; a frame in between in which none does is bridged or NaN.
    ``slots`` (F, M) says which of the people in each view this is, -1 in a view that does not see them, and
    ``more_slots`` a second one, where a detector has split the person into two. ``refinement`` is a
    `SequenceRefinement`, or from `Tracker.step` a `Refinement` of one frame.
    """

    id: int
    frames: Index = field(repr=False)
    slots: Index = field(repr=False)
    more_slots: Index = field(repr=False)
    refinement: Refinement

    def detections(self, people: People) -> Array:
        """Return this person's detections (F, M, N, 2|3) among the ``people`` given to ``track``."""
        array = padded(people)[self.frames]
        if not len(self.frames):
            raise InvalidInputError("detections: expected a person of a recording, got one of Tracker.step")
        own, more = (take_people(array, slots) for slots in (self.slots, self.more_slots))
        missing = ~np.isfinite(own[..., :2]).all(axis=-1) | (own[..., 2:] == 0.0).any(axis=-1)
        return np.where(missing[..., None], more, own)


def track(
    people: People,
    cameras: Cameras,
    *,
    fps: float,
    layout: str | Layout,
    max_people: int | None = None,
    config: RefineConfig | None = None,
    progress: bool | Progress = False,
) -> list[Person]:
    """Find out who is who across views and over time, and refine everybody as ``refine_sequence`` does.

    The order of the people in a view means nothing. A person appears once two views agree on them, for at
    least 0.2 s, and remains while one view sees them, for up to three seconds. Detections that no second view
    confirms are left out. Whoever is away for longer than five seconds comes back as another person.
    docs/method.md has the mathematics.

    Parameters
    ----------
    people : (T, M, P, N, 2|3), or per frame a list of M views with (P_i, N, 2|3) each
        Up to P people per view: pixels, with confidence if there are three values. NaN where a slot is empty
        or a joint is missing. The frames of one recording in order, at a constant rate.
    cameras, fps, config, progress
        As in ``refine_sequence``.
    layout : str or Layout
        The joints. The proportions of a built-in one help to tell a person from a chance agreement.
    max_people : int, optional
        Return at most so many: those whom the views see most.

    Returns
    -------
    list of Person
        In the order of their appearance, those who are there from the same frame on in that of their support.

    Warns
    -----
    UserWarning
        As ``refine_sequence``; if views detect people but nobody is found, too many people are in a frame to
        compare all, or left and right limbs differ in length as with a wrong layout.
    """
    positive("fps", fps)
    prepared = _skelsplat.Refiner(cameras, layout=layout, config=config)
    names = [getattr(one, "name", None) or f"camera {k}" for k, one in enumerate(cameras)]
    frames = _frames(people, cameras)
    frames = of_new_images(frames, names) if frames.ndim == 5 else frames
    with reporter(progress) as report:
        found, cut, shared, alone = _skelsplat.track_people(
            prepared, layout, frames, float(fps), max_people=_count(max_people), progress=report
        )
    everybody = [_person(out, out.pop("first"), SequenceRefinement) for out in found]
    for person in everybody:
        warn_of_size(person.refinement.pose, cameras, layout)
    in_vain = 0 if everybody else _frames_of_two_views(frames)
    if in_vain >= max(3.0, min(_IN_VAIN_S * fps, 0.5 * len(frames))):
        warn(nobody_found(in_vain))
    if cut:
        warn(people_uncompared(cut, most_people(frames)))
    for contradiction in _find_contradictions(names, shared, alone):
        warn(contradiction)
    limbs = _unequal_limbs(everybody, cameras, layout)
    if limbs is not None:
        warn(limbs)
    return everybody


def nobody_found(frames: int) -> Finding:
    """Return the finding that in so many frames no two views agree on a person."""
    sentence = (
        f"In {frames} frames two or more views detect people, but no two agree on a person: check the unit "
        "of the cameras, their order, and that all detections of a frame are from the same instant."
    )
    return Finding("nobody_found", numbers={"frames": frames}, sentence=sentence)


def _find_contradictions(names: Sequence[str], shared: Index, alone: Index) -> Iterator[Finding]:
    """Yield a finding on cameras that do not agree with most others on who is there, by counts (M, M)."""
    differ = np.maximum(alone, alone.T)
    part = differ / np.maximum(differ + shared, _LEAST_FRAMES)
    half = (len(part) - 1) / 2
    named = np.flatnonzero((part < _AGREE).sum(axis=1) - 1 <= half)  # a camera agrees with itself
    if (part >= _CONTRARY).sum(axis=1).max(initial=0) <= max(half, 0):  # no cameras without frames
        return
    cameras = tuple(names[int(i)] for i in named)
    shares = [float(differ[i].sum() / (differ[i] + shared[i]).sum()) for i in named]
    shown = listed([f"{name} {percent(part)}" for name, part in zip(cameras, shares, strict=True)])
    sentence = f"Cameras contradict each other on where people are ({shown} of those two should share): a "
    sentence += "calibration is wrong, or the videos are not synchronised. The same person may be found "
    sentence += "twice, and some are chance agreements of two views. Check the cameras."
    numbers = {"shares": shares}
    yield Finding("cameras_contradict", "warning", Subject(cameras=cameras), numbers, sentence=sentence)


def people_uncompared(frames: int, most: int) -> Finding:
    """Return the finding that in so many frames, with up to ``most`` people a view, not all were compared."""
    where = f"{frames:,} frames" if frames > 1 else "a frame"
    return Finding(
        "people_uncompared",
        numbers={"frames": frames, "most": most},
        remedy=(Remedy("without", None),),
        sentence=f"In {where} there were too many people to compare all of them (up to {most:,} in a view); "
        "the best of those compared was chosen, so somebody may be missing. To compare all of them, use "
        "fewer views or a higher detection threshold.",
    )


def layouts_alike(layout: Layout) -> list[str]:
    """Return the other built-in layouts of as many joints."""
    alike = [name for name in _skelsplat.LAYOUT_NAMES if Layout.by_name(name).n_joints == layout.n_joints]
    return [name for name in alike if name != layout.name]


def limbs_differ(layout: Layout, lengths_mm: Array) -> Finding | None:
    """Return a finding on the symmetric pair of limbs (pairs, 2) that differs most, if implausibly."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = np.nan_to_num(lengths_mm.max(axis=1) / lengths_mm.min(axis=1), nan=0.0, posinf=0.0)
    if ratios.max(initial=0.0) <= _LIMB_RATIO:
        return None
    worst = int(ratios.argmax())
    limbs = [[layout.joints[joint] for joint in limb] for limb in layout.symmetric_pairs(2)[worst]]
    lengths, others = lengths_mm[worst].tolist(), layouts_alike(layout)
    sizes = " and ".join(
        f"{a} to {b} {length(size, 0, 10.0)} mm" for (a, b), size in zip(limbs, lengths, strict=True)
    )
    hint = f" ({' and '.join(others)} has the same number of joints)" if others else ""
    return Finding(
        "limbs_differ",
        subject=Subject(joints=tuple(dict.fromkeys(joint for limb in limbs for joint in limb))),
        numbers={"limbs": limbs, "lengths_mm": lengths, "layouts_of_as_many_joints": others},
        remedy=(Remedy("layout", None),),
        sentence=f"Left and right limbs differ in length, {sizes}. Is the layout correct{hint}?",
    )


def _unequal_limbs(everybody: Sequence[Person], cameras: Cameras, layout: str | Layout) -> Finding | None:
    """Return a finding on the left and right limb that differ most over everybody, if they do."""
    layout = Layout.by_name(layout) if isinstance(layout, str) else layout
    pairs = layout.symmetric_pairs(2)
    sizes = []  # (pairs, 2) of each person, NaN where a limb is no bone
    for person in everybody:
        found = person.refinement
        if len(person.frames) >= _LEAST_FRAMES and isinstance(found, SequenceRefinement):
            bones = dict(zip(map(frozenset, found.bones.tolist()), found.bone_lengths, strict=True))
            sizes.append([[bones.get(frozenset(limb), np.nan) for limb in pair] for pair in pairs])
    if not sizes or not pairs:
        return None
    return limbs_differ(layout, np.median(sizes, axis=0) * mm_per_unit(cameras))


def _frames(people: People, cameras: Cameras) -> Array:
    """Return ``people`` as an array, with a view for each of the cameras."""
    frames = padded(people)
    if len(cameras) < 2:
        raise InvalidInputError(f"cameras: expected at least two, got {len(cameras)}")
    if frames.ndim == 5 and len(frames) and frames.shape[1] != len(cameras):
        raise InvalidInputError(f"people: expected {len(cameras)} views, got {frames.shape[1]}")
    return frames


def most_people(frames: Array) -> int:
    """Return the largest number of people in a view of frames (T, M, P, N, 2|3)."""
    return int(np.isfinite(frames[..., 0]).any(axis=-1).sum(axis=-1).max())


def _frames_of_two_views(frames: Array) -> int:
    """Return in how many frames (T, M, P, N, 2|3) two or more views have a detection."""
    there = ~np.isnan(frames[..., 0]) & (frames[..., 2:] != 0.0).all(axis=-1)
    return int((there.any(axis=(2, 3)).sum(axis=1) >= 2).sum())


def _person(out: dict[str, Any], first: int | None, kind: type[Refinement]) -> Person:
    """Return a person of a recording from its ``first`` frame on, or of a live loop."""
    number, slots, more = out.pop("id"), out.pop("slots"), out.pop("more_slots")
    frames = np.empty(0, dtype=np.int64) if first is None else np.arange(first, first + len(slots))
    return Person(number, frames, slots, more, kind(**refinement_fields(out)))


def _count(most: int | None) -> int | None:
    if most is not None:
        positive("max_people", most, "integer")
    return most


def padded(people: People) -> Array:
    """Return people as an array (T, M, P, N, 2|3), NaN in empty slots."""
    if hasattr(people, "__array__") or not isinstance(people, list | tuple):
        return numbers(people, "people")
    frames = [[numbers(() if view is None else view, "people") for view in frame] for frame in people]
    views = [view for frame in frames for view in frame]
    shapes = {view.shape[1:] for view in views if view.size}
    counts = {len(frame) for frame in frames}
    if len(counts) > 1 or len(shapes) > 1 or any(len(shape) != 2 for shape in shapes):
        expected = "as many views in every frame, of (P, N, 2) or (P, N, 3) each"
        raise InvalidInputError(f"people: expected {expected}, got {counts} views of P times {shapes}")
    empty = {view.shape[1:] for view in views if view.ndim == 3}
    joints = (shapes or empty or {(0, 3)}).pop()
    most = max((len(view) for view in views if view.size), default=0)
    out = np.full((len(frames), max(counts, default=0), most, *joints), np.nan)
    for t, frame in enumerate(frames):
        for i, view in enumerate(frame):
            if view.size:
                out[t, i, : len(view)] = view
    return out


class Tracker:
    """Follow several people frame by frame as they arrive: a live loop with any detector.

    ``skelsplat live --people all`` is the same for programs in other languages. Parameters are those of
    ``track``; of ``max_people`` the first that appear are followed.
    """

    def __init__(
        self,
        cameras: Cameras,
        *,
        layout: str | Layout,
        fps: float,
        max_people: int | None = None,
        config: RefineConfig | None = None,
    ) -> None:
        positive("fps", fps)
        prepared = _skelsplat.Refiner(cameras, layout=layout, config=config)
        self._compiled = _skelsplat.Tracker(prepared, layout, float(fps), max_people=_count(max_people))
        self._cameras = cameras
        self._doubtful = round(_IN_VAIN_S * fps)  # frames in vain after which to warn
        self._in_vain: int | None = 0  # None: somebody was found, or the warning given
        self._cut = False  # whether it was said that there are too many people

    @property
    def ids(self) -> tuple[int, ...]:
        """Identities that ``step`` can still return: of people who are seen, and of those out of sight."""
        return tuple(self._compiled.ids())

    def step(self, people: ArrayLike | Sequence[ArrayLike | None]) -> list[Person]:
        """Return everybody who is known in the next frame, with one frame each, in order of identity.

        ``people`` is (M, P, N, 2|3), or a list of M views with (P_i, N, 2|3) each, of which None is a view of
        nobody. ``frames`` of the persons is empty, ``slots`` is (M,). A person whom no view sees is bridged
        for up to half a second. After an `InvalidInputError` the state is as it was.
        """
        one = [people] if isinstance(people, Sequence) else numbers(people, "people")[None]
        frame = _frames(one, self._cameras)
        if frame.ndim != 5:
            got = frame.shape[1:]
            raise InvalidInputError(f"people: expected shape (M, P, N, 2) or (M, P, N, 3), got {got}")
        found = self._compiled.step(frame)
        if self._in_vain is not None:
            self._in_vain = None if found else self._in_vain + _frames_of_two_views(frame)
            if self._in_vain == self._doubtful > 0:
                warn(nobody_found(self._in_vain))
                self._in_vain = None
        if not self._cut and self._compiled.cut():
            self._cut = True
            warn(people_uncompared(1, most_people(frame)))
        return [_person(out, None, Refinement) for out in found]

    def __copy__(self) -> NoReturn:
        raise TypeError("a Tracker holds the frames before and is not copied: make another one")

    def reset(self) -> None:
        """Forget everybody; identities are not used again."""
        self._compiled.reset()
