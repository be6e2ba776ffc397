"""Which joint of the file is which joint of the layout: by name, else by a count that the user names."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array
from skelsplat.exceptions import DatasetError, InvalidInputError
from skelsplat.io._files import listed
from skelsplat.io.detections._format import Person, View

Joint = str | int | None
# place in the file of each joint of the layout, None for one that the file lacks
Places = tuple[int | None, ...]

_SIDES = {"l": "left", "r": "right"}
_SHOWN = 40
_UNKNOWN = "no known layout"
_CUSTOM = (
    "; choose a known one with --layout and assign its joints with --map JOINT=NAME (in Python layout= and "
    "mapping=), where NAME is a name, a place from 0, or none; a layout of just these joints needs Python "
    "(skelsplat.Layout)"
)


def choose_layout(layout: str | sk.Layout | None, views: Iterable[View]) -> sk.Layout:
    """Return the layout that is asked for, or the one whose joints the files name exactly."""
    if isinstance(layout, str):
        return sk.layouts.get(layout)
    if layout is not None:
        return layout
    hint = "the files hold no person to count joints of"
    for view in views:
        named = [known for known in _known() if view.joints and _same_joints(known, view.joints)]
        if len(named) == 1:
            return named[0]
        if view.joints and not view.own_order:
            hint = f"{view.path} names {listed(view.joints, _SHOWN)}: {_named_layouts(view.joints)}"
            break
        counted = _count(view)
        if counted:
            path, joints = counted
            names = f"; it names {listed(view.joints, _SHOWN)}" if view.joints else ""
            hint = f"{path} has {joints} joints per person: {layouts_of(joints)}{names}{_advice_on(joints)}"
            break
    raise InvalidInputError(f"layout: expected the name of a joint layout, got none; {hint}")


def _known() -> list[sk.Layout]:
    return [sk.layouts.get(name) for name in sk.layouts.names]


def _same_joints(layout: sk.Layout, names: Sequence[str]) -> bool:
    return len(names) == layout.n_joints and {_key(n) for n in names} == {_key(n) for n in layout.joints}


def _count(view: View) -> tuple[Path, int] | None:
    """Return the file that says how many joints a person has, and the number; None without a person."""
    if view.joints is not None:
        return view.path, len(view.joints)
    people = (person for number in view.frames for person in view.people(number))
    first = next((person for person in people if len(person.joints)), None)
    return None if first is None else (first.path, len(first.joints))


def layouts_of(joints: int) -> str:
    """Names of the known layouts with that many joints, as a phrase."""
    fitting = [layout.name for layout in _known() if layout.n_joints == joints]
    return " or ".join(fitting) if fitting else _UNKNOWN


def _named_layouts(names: Sequence[str]) -> str:
    """Say which known layouts have all their joints among the names, or what to do if none has."""
    there = {_key(name) for name in names}
    fitting = [layout.name for layout in _known() if there.issuperset(map(_key, layout.joints))]
    return f"all joints of {' or '.join(fitting)}" if fitting else f"all those of {_UNKNOWN}{_CUSTOM}"


def _advice_on(joints: int) -> str:
    """Say what to do with so many joints if they are those of no known layout."""
    return "" if layouts_of(joints) != _UNKNOWN else _CUSTOM


def check_mapping(mapping: Mapping[str, Joint] | None, layout: sk.Layout) -> dict[str, Joint]:
    """Return the mapping, or raise `InvalidInputError` if it is none from the layout's joints."""
    for joint, target in (mapping or {}).items():
        if joint not in layout.joints:
            expected = f"a joint of {layout.name} ({', '.join(layout.joints)})"
            raise InvalidInputError(f"mapping: expected {expected}, got {joint!r}")
        if not (target is None or isinstance(target, str) or (type(target) is int and target >= 0)):
            expected = "a name, a place from 0, or None"
            raise InvalidInputError(f"mapping[{joint}]: expected {expected}, got {target!r}")
    return dict(mapping or {})


def places_of(view: View, layout: sk.Layout, mapping: Mapping[str, Joint]) -> Places | None:
    """Return the place in the file of every joint of the layout, or None: the order is the layout's own.

    With names in the file every joint needs its name there, however it is written (``LHip``, ``hip_l``,
    ``left hip``), or an entry of `mapping`. Where the detector's order is fixed, an equal count is enough as
    long as no name contradicts the layout. Without names only `mapping` can differ from the layout's order.
    """
    if view.joints is None:
        return _without_names(view, layout, mapping) if mapping else None
    if not mapping and view.own_order and _confirmed(view.joints, layout):
        return None
    keys: dict[tuple[str, ...], list[int]] = {}
    for place, name in enumerate(view.joints):
        keys.setdefault(_key(name), []).append(place)
    named = {joint: keys.get(_key(joint), []) for joint in layout.joints if joint not in mapping}
    for joint, places in named.items():
        if len(places) > 1:
            names = ", ".join(view.joints[place] for place in places)
            raise _wrong(view, f"one name for {joint}", names)
    missing = [joint for joint, places in named.items() if not places]
    if missing:
        advice = f'mapping={{"{missing[0]}": …}} (--map {missing[0]}=…) assigns it'
        actual = f"none for {', '.join(missing)} among {listed(view.joints, _SHOWN)}; {advice}"
        raise _wrong(view, f"a name for every joint of {layout.name}", actual)
    return tuple(
        named[joint][0] if joint in named else _mapped(view, joint, mapping[joint]) for joint in layout.joints
    )


def _wrong(view: View, expected: str, actual: str) -> DatasetError:
    return DatasetError(view.path, "joint names", expected, actual)


def _without_names(view: View, layout: sk.Layout, mapping: Mapping[str, Joint]) -> Places:
    names = [name for name in mapping.values() if isinstance(name, str)]
    if names:
        raise _wrong(view, f"the name {names[0]!r} (mapping)", "no names, only places")
    missing = [joint for joint in layout.joints if joint not in mapping]
    if missing:
        expected = f"--map (in Python mapping=) for every joint of {layout.name}, as the file has no names"
        raise _wrong(view, expected, f"none for {', '.join(missing)}")
    return tuple(_mapped(view, joint, mapping[joint]) for joint in layout.joints)


def _confirmed(names: Sequence[str], layout: sk.Layout) -> bool:
    """Say whether the names that belong to the layout stand at its places, and are half of it or more."""
    known = {_key(joint): place for place, joint in enumerate(layout.joints)}
    stands = [known[_key(name)] == place for place, name in enumerate(names) if _key(name) in known]
    return len(names) == layout.n_joints and all(stands) and 2 * len(stands) >= layout.n_joints


def _mapped(view: View, joint: str, target: Joint) -> int | None:
    """Return the place of what a mapping says."""
    if not isinstance(target, str):
        return target
    names = view.joints or ()
    if target not in names:
        raise _wrong(view, f"{target!r} for {joint}", listed(names, _SHOWN))
    return names.index(target)


def _key(name: str) -> tuple[str, ...]:
    """Sort a name's words, in lower case, sides in full: ``LHip``, ``hip_left`` and ``Left hip`` are one."""
    words = re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+", name)
    return tuple(sorted(_SIDES.get(word.lower(), word.lower()) for word in words))


def arranged(person: Person, layout: sk.Layout, places: Places | None, *, flat: bool) -> Array:
    """Return a person's joints in the order of the layout (N, 3), NaN for those that the file lacks."""
    count, n = len(person.joints), layout.n_joints
    if places is None and count == n:
        return person.joints
    if flat and not count:  # nobody in this place
        return np.full((n, 3), np.nan)
    if places is None:
        expected, actual = f"{n} joints (layout {layout.name})", f"{count} ({layouts_of(count)})"
        if flat:
            expected = f"3·{n} = {3 * n} numbers (layout {layout.name})"
            actual = f"{3 * count} (3·{count}: {layouts_of(count)})"
        raise DatasetError(person.path, person.field, expected, actual + _advice_on(count))
    highest = max((place for place in places if place is not None), default=-1)
    if highest >= count:
        expected = f"a joint at place {highest} (mapping)"
        raise DatasetError(person.path, person.field, expected, f"{count} joints")
    padded = np.vstack([person.joints, np.full(3, np.nan)])
    return padded[[-1 if place is None else place for place in places]]
