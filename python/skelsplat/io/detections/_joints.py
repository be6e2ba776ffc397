"""Which joints detections have: their layout, and which joint of the file is which of the layout."""

from __future__ import annotations

import os
import re
import unicodedata
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array
from skelsplat._budget import check_document, read_text
from skelsplat.exceptions import DatasetError, InvalidInputError
from skelsplat.findings import Finding, Subject, warn
from skelsplat.io._files import listed
from skelsplat.io.detections._format import View
from skelsplat.io.detections._registry import find_format, recognised

OF_FILE = "file"  # for a layout's name: the joints of the detections, as their files name them

Joint = str | int | None

# the letters of LHip, hip_l, Hüfte and 肩; capitals beyond ASCII begin no word
_WORDS = re.compile(r"[A-Z]+(?![^\W\d_A-Z])|[A-Z]?[^\W\d_A-Z]+|\d+")
_SIDES = {"l": "left", "r": "right"}
# numbers of points that only one detector's layout has among those that are published
_COUNTED = (21, 33, 133, 136)
_SHOWN, _MOST_PAIRS = 40, 6  # names, and pairs of them, in a message
_UNKNOWN = "no known layout"
_CUSTOM = "; choose a known layout= and assign its joints with mapping=, or describe these in a layout file"
_AS_NAMED = '; layout="file" takes the joints as they are named'


class Skeleton(NamedTuple):
    """Names of N joints in the order of the file, and pairs of places that are connected (none: unknown)."""

    names: tuple[str, ...]
    edges: tuple[tuple[int, int], ...]


def read_skeleton(path: str | os.PathLike[str]) -> Skeleton:
    """Read the skeleton of detections: of a file, or of the first in a folder that `read_detections` takes.

    SLEAP's analysis h5 has names and edges; DeepLabCut's h5 and csv, and other formats in which joints have
    names, only these; DeepLabCut's project file ``config.yaml`` has both.
    """
    root = Path(path)
    if root.suffix.lower() in (".yaml", ".yml"):
        return _dlc_project(root)
    form = find_format(root, None)
    file = recognised(root)[form.name]
    views: Mapping[str, View] = {}
    try:
        if form.files is not None:
            views = form.files({"": file})
    except DatasetError:  # perhaps a file of all cameras
        if form.recording is None:
            raise
    if not views and form.recording is not None:
        views = form.recording(file, None).views
    return _skeleton_of(views.values(), file, form.name)


def _skeleton_of(views: Collection[View], path: Path, form: str) -> Skeleton:
    view = next(iter(views), None)
    if view is None or view.joints is None:
        expected = "a format in which joints have names"
        raise DatasetError(path, "joint names", expected, f"{form}, where they have numbers")
    return Skeleton(view.joints, view.edges)


def _dlc_project(path: Path) -> Skeleton:
    text = read_text(path)
    check_document(path, text)
    # single- and multi-animal projects; the latter writes "MULTI!" under the key of the former
    names = _yaml_texts(text, "multianimalbodyparts") or _yaml_texts(text, "bodyparts")
    if not names or len(set(names)) < len(names):
        expected = "a list of different names, as in a DeepLabCut project's config.yaml"
        raise DatasetError(path, "bodyparts", expected, names or "none")
    ends = _yaml_texts(text, "skeleton")
    pairs = zip(ends[::2], ends[1::2], strict=False)
    # others are of the template, or of a part of no individual
    edges = tuple((names.index(a), names.index(b)) for a, b in pairs if {a, b} <= set(names))
    return Skeleton(tuple(names), edges)


def _yaml_texts(text: str, name: str) -> list[str]:
    """Return the texts of the list, or the list of lists, under a top-level key of a YAML document."""
    block = re.search(rf"^{name}:(.*?)(?=^\w|\Z)", text, re.MULTILINE | re.DOTALL)
    bare = re.sub(r"(^|\s)#.*", "", block[1] if block else "")
    if not bare.lstrip().startswith(("-", "[")):
        return []
    parts = re.split(r"[\[\],]|^\s*(?:-\s+)+", bare, flags=re.MULTILINE)
    return [part.strip().strip("'\"") for part in parts if part.strip()]


def check_layout(layout: str | os.PathLike[str] | sk.Layout) -> None:
    """Raise, before long work, what `read_layout` would raise of a name or a layout file."""
    if layout != OF_FILE and _skeleton_file(layout) is None:
        sk.layouts.get(layout)


def _skeleton_file(layout: str | os.PathLike[str] | sk.Layout) -> Path | None:
    """Return the path of what has a skeleton and is no layout file, or None."""
    if isinstance(layout, sk.Layout) or str(layout).lower() in sk.layouts.names:
        return None
    path = Path(layout)
    return path if path.suffix.lower() != ".toml" and path.exists() else None


def read_layout(layout: str | os.PathLike[str] | sk.Layout) -> sk.Layout:
    """Return a layout by its name, or that of a layout file, or of a file that `read_skeleton` reads.

    The left-right pairs of a skeleton are those that its names state, and a note says which. An unknown name
    is an `InvalidInputError`; a file that cannot be read or whose joints have no names a `DatasetError`.
    """
    if layout == OF_FILE:
        raise InvalidInputError("layout: expected a name or a path, as there are no detections, got file")
    file = _skeleton_file(layout)
    return sk.layouts.get(layout) if file is None else _of_skeleton(read_skeleton(file), file)


def _of_skeleton(skeleton: Skeleton, path: Path) -> sk.Layout:
    names, edges = skeleton
    try:
        name = path.resolve().stem
        name = f"{name}_file" if name in sk.layouts.names else name
        limbs = {frozenset(edge): edge for edge in edges}  # some files list one several times
        layout = sk.layouts.from_names(name, names, list(limbs.values()))
    except InvalidInputError as error:
        raise DatasetError.of_argument(path, error) from error
    pairs = [f"{names[left]}–{names[right]}" for left, right in layout.left_right]
    numbers = {"joints": len(names), "limbs": len(layout.limbs), "pairs": pairs}
    named = f"{len(pairs)} left–right pairs by name ({listed(pairs, _MOST_PAIRS) or 'none'})"
    words = f"The layout is that of {path}: {len(names)} joints, {len(layout.limbs)} limbs, {named}."
    warn(Finding("layout_of_file", "note", Subject(files=(str(path),)), numbers, sentence=words))
    return layout


def choose_layout(
    layout: str | os.PathLike[str] | sk.Layout | None, views: Collection[View], path: Path, form: str
) -> sk.Layout:
    """Return the layout that is asked for, or the one that names or number of the joints tell."""
    if layout == OF_FILE:
        return _of_skeleton(_skeleton_of(views, path, form), path)
    if layout is not None:
        return read_layout(layout)
    wanted = "layout: expected a joint layout's name or file, got none"
    counted = next(filter(None, map(_counted, views)), None)
    if counted is None:
        raise InvalidInputError(f"{wanted}; the files hold no person to count joints of")
    view, count = counted
    names, built_in = view.joints or (), [sk.layouts.get(name) for name in sk.layouts.names]
    keys = {known.name: [_key(joint) for joint in known.joints] for known in built_in}
    own = [_key(name) for name in names]
    fitting = [known for known in built_in if sorted(own) == sorted(keys[known.name])]
    if not fitting and count in _COUNTED and (not names or view.own_order):
        alike = (known for known in built_in if known.n_joints == count)
        fitting = [known for known in alike if not names or _confirmed(names, known)]
    if len(fitting) == 1:
        return fitting[0]
    if names and not view.own_order:
        within = [name for name, joints in keys.items() if set(joints) <= set(own)]
    else:
        within = [known.name for known in built_in if known.n_joints == count]
    there = f" ({listed(names, _SHOWN)})" if names else ""
    advice = _AS_NAMED * bool(names) + _CUSTOM * (not within)
    known = " or ".join(within) or _UNKNOWN
    raise InvalidInputError(f"{wanted}; {view.path} has {count} joints per person{there}: {known}{advice}")


def _counted(view: View) -> tuple[View, int] | None:
    """Return a view and how many joints a person has; None without anybody."""
    if view.joints is not None:
        return view, len(view.joints)
    frames = (frame for t in range(len(view.frames)) for frame in view.people(np.array([t])))
    return next(((view, len(person)) for frame in frames for person in frame if len(person)), None)


def _key(name: str) -> tuple[str, ...]:
    """Sort a name's words, in lower case, sides in full: ``LHip``, ``hip_left`` and ``Left hip`` are one."""
    words = _WORDS.findall(unicodedata.normalize("NFKC", name))
    return tuple(sorted(_SIDES.get(word.lower(), word.lower()) for word in words))


def _confirmed(names: Sequence[str], layout: sk.Layout) -> bool:
    """Say whether the names that belong to the layout stand at its places, and are half of it or more."""
    known = {_key(joint): place for place, joint in enumerate(layout.joints)}
    stands = [known[_key(name)] == place for place, name in enumerate(names) if _key(name) in known]
    return len(names) == layout.n_joints and all(stands) and 2 * len(stands) >= layout.n_joints


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


def places_of(view: View, layout: sk.Layout, mapping: Mapping[str, Joint]) -> list[int] | None:
    """Return the place in the file of every joint of the layout, or None: the order is the layout's own.

    The place is -1 for a joint that the file lacks. Every joint needs its name in the file, however it is
    written (``LHip``, ``hip_l``, ``left hip``), or an entry of `mapping`. Where the detector's order is
    fixed, an equal count is enough as long as no name contradicts the layout.
    """
    names = view.joints or ()
    if not mapping and (view.joints is None or (view.own_order and _confirmed(names, layout))):
        return None
    keys = [_key(name) for name in names]
    places, missing = [], []
    for joint in layout.joints:
        fitting = [place for place, words in enumerate(keys) if words == _key(joint)]
        if joint in mapping:
            places.append(_mapped(view, joint, mapping[joint]))
        elif len(fitting) > 1:
            raise _wrong(view, f"one name for {joint}", ", ".join(names[place] for place in fitting))
        elif fitting:
            places += fitting
        else:
            missing.append(joint)
    if missing:
        advice = (
            f'mapping={{"{missing[0]}": "NAME"}} assigns it, mapping={{"{missing[0]}": None}} leaves it out'
        )
        actual = f"none for {', '.join(missing)} among {listed(names, _SHOWN) or 'no names'}; {advice}"
        raise _wrong(view, f"a name for every joint of {layout.name}", actual)
    _check_once(places, view, layout)
    return places


def _wrong(view: View, expected: str, actual: str) -> DatasetError:
    return DatasetError(view.path, "joint names", expected, actual)


def _mapped(view: View, joint: str, target: Joint) -> int:
    """Return the place of what a mapping says."""
    if not isinstance(target, str):
        return -1 if target is None else target
    names = view.joints or ()
    if target not in names:
        raise _wrong(view, f"{target!r} for {joint} (mapping=)", listed(names, _SHOWN) or "no names")
    return names.index(target)


def _check_once(places: list[int], view: View, layout: sk.Layout) -> None:
    """Raise `InvalidInputError` if two joints have one place: one point is no evidence of two."""
    names, joints = view.joints or (), dict[int, str]()
    for joint, place in zip(layout.joints, places, strict=True):
        if place >= 0 and joints.setdefault(place, joint) != joint:
            point = repr(names[place]) if place < len(names) else f"index {place}"
            actual = f'{point} for {joints[place]} and {joint} (mapping={{"{joint}": None}} leaves one out)'
            raise InvalidInputError(f"mapping: expected a different point for each joint, got {actual}")


def arranged(person: Array, layout: sk.Layout, places: list[int] | None, path: Path) -> Array:
    """Return a person's joints in the order of the layout (N, 3), NaN for those that the file lacks."""
    count, n = len(person), layout.n_joints
    if not count:  # nobody in this place
        return np.full((n, 3), np.nan)
    if places is None and count == n:
        return person
    if places is None:
        fitting = [name for name in sk.layouts.names if sk.layouts.get(name).n_joints == count]
        actual = f"{count} ({' or '.join(fitting) or _UNKNOWN}){_CUSTOM}"
        raise DatasetError(path, "keypoints", f"{n} joints (layout {layout.name})", actual)
    if max(places) >= count:
        raise DatasetError(path, "keypoints", f"a joint at place {max(places)} (mapping)", f"{count} joints")
    return np.vstack([person, np.full(3, np.nan)])[places]
