"""From everybody's detections to the inputs of one person, or of each: who is who over time."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import skelsplat as sk
from skelsplat import association
from skelsplat._arrays import Array, Index
from skelsplat._people import Person
from skelsplat._sequence import frames_of
from skelsplat.exceptions import DatasetError, InvalidInputError
from skelsplat.findings import Finding, Remedy, Subject, collected_warnings, warn
from skelsplat.io.detections import camera_called
from skelsplat.run.cameras import read_adjusted
from skelsplat.run.job import Job
from skelsplat.run.people import find_doubts, find_left_out
from skelsplat.run.person import MOVES_MOST, count_people, entry_of, look_around, pick_places, point_of
from skelsplat.run.read import Inputs, Opened
from skelsplat.run.solve import Progress, even_clock, is_sparse, silent, spread

# Settings of the paper's method that following people over time understands as well.
_SHARED = ("min_confidence", "undistort", "n_threads")
# A point is on a person up to this part of their size in the image from a joint.
_NEAR = 0.5


@dataclass(frozen=True)
class Everybody:
    """The people of a recording, each with the inputs of a run.

    ``people`` are in the order of their appearance; ``person`` is their identity, a number from 0, and
    ``frames`` are those from the first to the last in which two views see them.
    """

    people: tuple[Inputs, ...]
    detected: Index  # (T, M) how many people each view detects,
    assigned: Index  # (T, M) and how many of them are one of ``people``
    whole: Inputs  # the recording, with nobody chosen; its ``doubts`` concern everybody


def read_inputs(opened: Opened, job: Job, progress: Progress, check: Callable[[Inputs], None]) -> Inputs:
    """Read the detections and follow one person through them.

    The largest is an identity where the frame rate is known; otherwise the largest in each image.
    ``check`` is called as soon as the frames of the result are known, before the person if possible.
    """
    people, whole = read_adjusted(opened, job)
    person = str(job.person)
    entry, alone = entry_of(person), people.shape[2] == 1
    by_place = entry is not None or (person == "largest" and whole.fps is None)
    if person != "consistent" and not (by_place or (alone and (person == "largest" or person.isdecimal()))):
        found = choose(follow_everybody(people, whole, job, progress), person)
        check(found)
        return found
    check(whole)
    everybody = association.separate_people(people, whole.rig, layout=whole.layout, fps=whole.fps)
    index, unmatched = pick_places(people, person, everybody)
    if by_place and not alone:
        which = "The largest in each image, as the frame rate is unknown,"
        which = which if entry is None else f"Entry {entry} of each file"
        words = f"{which} need not be one person; the person the views agree on (consistent) is, and with "
        words += "the frame rate so is everyone who is followed."
        remedies = (Remedy("fps", None), Remedy("person", "consistent"))
        warn(Finding("person_by_place", "warning", remedy=remedies, sentence=words))
    crowd = look_around((everybody >= 0).sum(axis=2))
    chosen = association.take_people(people, index)
    return replace(whole, detections=chosen, unmatched=unmatched, person=person, crowd=crowd)


def follow_everybody(people: Array, whole: Inputs, job: Job, progress: Progress = silent) -> Everybody:
    """Find out who is who among people (T, M, P, N, 3); an error if nobody is found."""
    _check_times(whole, job)
    places, rate = even_clock(whole)
    config = job.settings
    if config.method == "paper":
        config = sk.RefineConfig(**{name: getattr(config, name) for name in _SHARED})
    seen, begin = spread(people, places), time.perf_counter()
    found = _track(seen, whole, rate, job, config, progress)
    each = (time.perf_counter() - begin) / max(1, len(found))
    detected = count_people(people)
    if not found:
        raise _nobody(job, whole, detected)
    kept = [_inputs(person, seen, whole, places, each) for person in found]
    kept = [replace(one, doubts=tuple(find_doubts(kept, one))) for one in kept]
    assigned = np.zeros((len(seen), people.shape[1]), dtype=np.int64)
    for person in found:
        for slots in (person.slots, person.more_slots):
            assigned[person.frames] += slots >= 0
    assigned = np.minimum(assigned[places], detected)
    if len(found) != job.people:  # else others may be left out on purpose
        whole = replace(whole, doubts=tuple(find_left_out(detected, assigned, whole)))
    return Everybody(tuple(kept), detected, assigned, whole)


def _track(
    seen: Array, whole: Inputs, rate: float, job: Job, config: sk.RefineConfig, progress: Progress
) -> list[Person]:
    """Follow people on an even clock, without the warnings that are findings about each of them."""
    steps = len(seen)

    def half_each(done: int, total: int) -> None:
        """Report following all frames, and then solving everybody's, as half of the work each."""
        solved = (done - steps) * steps // (total - steps) if total > steps else 0
        progress((min(done, steps) + solved) // 2, steps)

    with collected_warnings() as told:
        found = sk.track(
            seen,
            whole.rig,
            fps=rate,
            layout=whole.layout,
            max_people=job.people if isinstance(job.people, int) else None,
            config=config,
            progress=half_each,
        )
    for one in told:
        if one.kind not in ("nobody_found", "limbs_differ"):
            warn(one)
    return found


def _check_times(whole: Inputs, job: Job) -> None:
    """Raise an error if people cannot be followed: no frame rate, or the files lack most frames."""
    why = f"people={job.people}" if job.people is not None else f'person="{job.person}"'
    if whole.fps is None:
        expected = f"the frame rate, which following people over time needs ({why})"
        got = "none: neither the files nor videos state it"
        got += "; entry:N takes an entry of each file" if str(job.person).isdecimal() else ""
        raise InvalidInputError(f"fps: expected {expected}, got {got}")
    if is_sparse(whole):
        expected = f"most frames, to follow people over time ({why})"
        got = f"{len(whole.frames)} from {whole.frames[0]} to {whole.frames[-1]}"
        raise DatasetError(Path(job.detections), "frames", expected, got)


def _nobody(job: Job, whole: Inputs, detected: Index) -> DatasetError:
    there = detected > 0
    counts = zip(whole.rig.names, there.sum(axis=0), strict=True)
    seen = ", ".join(f"{name} {count:,}" for name, count in counts)
    advice = "no two views detect anybody in the same frame"
    if (there.sum(axis=1) >= 2).any():
        advice = "exchanged cameras, a wrong unit, layout or calibration, or unsynchronised videos? "
        advice += "skelsplat check-cameras looks for the cause"
    got = f"nobody, though people are detected ({seen} of {len(there):,} frames): {advice}"
    got = got if there.any() else "no detections of people"
    return DatasetError(Path(job.detections), "people", "somebody on whom two views agree", got)


def _inputs(person: Person, seen: Array, whole: Inputs, places: Index, seconds: float) -> Inputs:
    """Return the inputs of a person among people ``seen`` on an even clock."""
    here = np.flatnonzero((places >= person.frames[0]) & (places <= person.frames[-1]))
    rows = places[here] - person.frames[0]
    result = person.refinement
    if not isinstance(result, sk.SequenceRefinement):
        raise TypeError("a person solved over time is needed")
    return replace(
        whole,
        detections=person.detections(seen)[rows],
        unmatched=whole.unmatched[here],
        frames=whole.frames[here],
        init_pose=None if whole.init_pose is None else whole.init_pose[here],
        person=str(person.id),
        solved=frames_of(result, rows),
        solved_s=seconds,
    )


def choose(everybody: Everybody, person: str) -> Inputs:
    """Return the person of a choice of `skelsplat.run.Job`, with the doubts about everybody."""
    people, point = everybody.people, point_of(person)
    numbered = {one.person: one for one in people}
    if point is not None:
        chosen = _at(people, *point)
    elif person == MOVES_MOST:
        chosen = max(people, key=_moved)
    elif person == "largest":
        chosen = max(people, key=_size)
    elif person in numbered:
        chosen = numbered[person]
    else:
        expected = f"one of {', '.join(numbered)} (the people found)"
        raise InvalidInputError(f"person: expected {expected}, got {person}")
    count = len(people)
    which = f"person {chosen.person} of {count} people, numbered from 0 in the order of appearance"
    words = f"Followed ({person}): {which if count > 1 else 'the only person found'}."
    numbers = {"identity": int(chosen.person), "people": count}
    remedy = (Remedy("people", "all"),) if count > 1 else ()
    warn(Finding("person_followed", "note", Subject(), numbers, remedy, sentence=words))
    return replace(chosen, doubts=(*everybody.whole.doubts, *chosen.doubts))


def _size(inputs: Inputs) -> float:
    """Return the extent in the images as a part of their diagonals, summed over frames and views."""
    diagonals = np.array([np.hypot(*camera.size) for camera in inputs.rig])
    return float((association.extents(inputs.detections) / diagonals).sum())


def _moved(inputs: Inputs) -> float:
    """Return the way of the median joint over all frames, in the unit of the cameras."""
    steps = np.linalg.norm(np.diff(inputs.solved_pose, axis=0), axis=-1)
    return float(np.median(np.nansum(steps, axis=0)))


def _at(people: Sequence[Inputs], camera: str, x: float, y: float) -> Inputs:
    """Return who is nearest to a point of a view in the first frame in which it sees one of the people."""
    name = camera_called(camera, people[0].rig.names, "person")
    view = list(people[0].rig.names).index(name)
    seen = []
    for one in people:
        joints = one.detections[:, view, :, :2]
        there = np.flatnonzero(np.isfinite(joints).any(axis=(1, 2)))
        seen += [(int(one.frames[t]), one.person, joints[t]) for t in there[:1]]
    if not seen:
        raise InvalidInputError(f"person: expected a camera that sees one of the people found, got {name}")
    first = min(frame for frame, *_ in seen)
    here = {who: joints for frame, who, joints in seen if frame == first}
    away = {who: float(np.nanmin(np.hypot(*(joints - (x, y)).T))) for who, joints in here.items()}
    nearest = min(away, key=lambda who: away[who])
    joints = here[nearest]
    if away[nearest] > _NEAR * float(association.extents(joints)):
        at = "{:.0f},{:.0f}".format(*joints[int(np.nanargmin(np.hypot(*(joints - (x, y)).T)))])
        got = f"one that is {away[nearest]:.0f} px from person {nearest}, the nearest, at {at}"
        raise InvalidInputError(f"person: expected a point on a person in frame {first} of {name}, got {got}")
    return next(one for one in people if one.person == nearest)
