"""Which joint of the file is which joint of the layout: by name, else by a count that the user names."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping, Sequence

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array
from skelsplat.exceptions import DatasetError, InvalidInputError
from skelsplat.io._files import listed
from skelsplat.io.detections._format import Person, View

Joint = str | int | None
# place in the file of each joint of the layout, None for one that the file lacks
Places = tuple[int | None, ...]

# the letters of LHip, hip_l, Hüfte and 肩; capitals beyond ASCII begin no word
_WORDS = re.compile(r"[A-Z]+(?![^\W\d_A-Z])|[A-Z]?[^\W\d_A-Z]+|\d+")
_SIDES = {"l": "left", "r": "right"}
_SHOWN, _TOGETHER = 40, 4
UNKNOWN = "no known layout"
CUSTOM = "; choose a known layout= and assign its joints with mapping=, or describe these in a layout file"
# to a layout of one's own, for files whose joints have no names
_PART = "; to use a part of them, state the place of every joint of {layout} with mapping="


def known_layouts() -> list[sk.Layout]:
    """Return the built-in layouts."""
    return [sk.layouts.get(name) for name in sk.layouts.names]


def layouts_of(joints: int) -> str:
    """Names of the known layouts with that many joints, as a phrase."""
    fitting = [layout.name for layout in known_layouts() if layout.n_joints == joints]
    return " or ".join(fitting) if fitting else UNKNOWN


def advice_on(joints: int) -> str:
    """Say what to do with so many joints if they are those of no known layout."""
    return "" if layouts_of(joints) != UNKNOWN else CUSTOM


def check_mapping(mapping: Mapping[str, Joint] | None, layout: sk.Layout) -> dict[str, Joint]:
    """Return the mapping, or raise `InvalidInputError` if it is none from the layout's joints."""
    for joint, target in (mapping or {}).items():
        if joint not in layout.joints:
            expected = f"a joint of {layout.name} ({', '.join(layout.joints)})"
            raise InvalidInputError(f"mapping: expected {expected}, got {joint!r}")
        if not (target is None or isinstance(target, str) or (type(target) is int and target >= 0)):
            expected = "a name, an index from 0, or None"
            raise InvalidInputError(f"mapping[{joint}]: expected {expected}, got {target!r}")
    return dict(mapping or {})


def places_of(view: View, layout: sk.Layout, mapping: Mapping[str, Joint]) -> Places | None:
    """Return the place in the file of every joint of the layout, or None: the order is the layout's own.

    With names in the file every joint needs its name there, however it is written (``LHip``, ``hip_l``,
    ``left hip``), or an entry of `mapping`. Where the detector's order is fixed, an equal count is enough as
    long as no name contradicts the layout. Without names only `mapping` can differ from the layout's order.
    """
    if view.joints is None:
        return _each_once(_without_names(view, layout, mapping), view, layout) if mapping else None
    if not mapping and view.own_order and confirmed(view.joints, layout):
        return None
    keys: dict[tuple[str, ...], list[int]] = {}
    for place, name in enumerate(view.joints):
        keys.setdefault(key(name), []).append(place)
    named = {joint: keys.get(key(joint), []) for joint in layout.joints if joint not in mapping}
    for joint, fitting in named.items():
        if len(fitting) > 1:
            names = ", ".join(view.joints[place] for place in fitting)
            raise _wrong(view, f"one name for {joint}", names)
    missing = [joint for joint, fitting in named.items() if not fitting]
    if missing:
        advice = f'mapping={{"{missing[0]}": …}} assigns it; None if the files lack it'
        actual = f"none for {', '.join(missing)} among {listed(view.joints, _SHOWN)}; {advice}"
        raise _wrong(view, f"a name for every joint of {layout.name}", actual)
    places = [
        named[joint][0] if joint in named else _mapped(view, joint, mapping[joint]) for joint in layout.joints
    ]
    return _each_once(tuple(places), view, layout)


def _each_once(places: Places, view: View, layout: sk.Layout) -> Places:
    """Return the places, or raise if two joints have the same: one point is no evidence of two."""
    names = view.joints or ()
    for place in places:
        joints = [joint for joint, its in zip(layout.joints, places, strict=True) if its == place]
        if place is not None and len(joints) > 1:
            point = repr(names[place]) if place < len(names) else f"index {place}"
            actual = f"{point} for {listed(joints, _TOGETHER)} (None if the files lack one)"
            raise InvalidInputError(f"mapping: expected a different point for each joint, got {actual}")
    return places


def _wrong(view: View, expected: str, actual: str) -> DatasetError:
    return DatasetError(view.path, "joint names", expected, actual)


def _without_names(view: View, layout: sk.Layout, mapping: Mapping[str, Joint]) -> Places:
    names = [name for name in mapping.values() if isinstance(name, str)]
    if names:
        raise _wrong(view, f"the name {names[0]!r} (mapping)", "no names, only places")
    missing = [joint for joint in layout.joints if joint not in mapping]
    if missing:
        expected = f"mapping= for every joint of {layout.name}, as the file has no names"
        raise _wrong(view, expected, f"none for {', '.join(missing)}")
    return tuple(_mapped(view, joint, mapping[joint]) for joint in layout.joints)


def confirmed(names: Sequence[str], layout: sk.Layout) -> bool:
    """Say whether the names that belong to the layout stand at its places, and are half of it or more."""
    known = {key(joint): place for place, joint in enumerate(layout.joints)}
    stands = [known[key(name)] == place for place, name in enumerate(names) if key(name) in known]
    return len(names) == layout.n_joints and all(stands) and 2 * len(stands) >= layout.n_joints


def _mapped(view: View, joint: str, target: Joint) -> int | None:
    """Return the place of what a mapping says."""
    if not isinstance(target, str):
        return target
    names = view.joints or ()
    if target not in names:
        raise _wrong(view, f"{target!r} for {joint}", listed(names, _SHOWN))
    return names.index(target)


def key(name: str) -> tuple[str, ...]:
    """Sort a name's words, in lower case, sides in full: ``LHip``, ``hip_left`` and ``Left hip`` are one."""
    words = _WORDS.findall(unicodedata.normalize("NFKC", name))
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
        own = "" if layout.name in sk.layouts.names else _PART.format(layout=layout.name)
        if layout.name == "hand21" and person.field.endswith("pose_keypoints_2d"):
            own = "; the keys hand_… and face_… of OpenPose are not read (docs/howto/openpose.md: Hands)"
        raise DatasetError(person.path, person.field, expected, actual + (advice_on(count) or own))
    highest = max((place for place in places if place is not None), default=-1)
    if highest >= count:
        expected = f"a joint at place {highest} (mapping)"
        raise DatasetError(person.path, person.field, expected, f"{count} joints")
    padded = np.vstack([person.joints, np.full(3, np.nan)])
    return padded[[-1 if place is None else place for place in places]]
