"""Which layout detections have: the one that is asked for, that of a file, or one that the files tell."""

from __future__ import annotations

import os
from collections.abc import Collection, Sequence
from pathlib import Path

import skelsplat as sk
from skelsplat.exceptions import DatasetError, InvalidInputError
from skelsplat.findings import Finding, Subject, warn
from skelsplat.io._files import listed
from skelsplat.io.detections._format import View
from skelsplat.io.detections._joints import (
    CUSTOM,
    UNKNOWN,
    advice_on,
    confirmed,
    key,
    known_layouts,
    layouts_of,
)
from skelsplat.io.detections._skeleton import read_skeleton

OF_FILE = "file"
"""In the place of a layout's name: the joints of the detections, as their files name them."""

_SHOWN = 40
_MOST_PAIRS = 6  # that a sentence lists
# Numbers of points that only one detector's layout has among those that are published.
_COUNTED = (21, 33, 133, 136)
_AS_NAMED = '; layout="file" takes the joints as they are named'


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


def read_layout(
    layout: str | os.PathLike[str] | sk.Layout, detections: str | os.PathLike[str] | None = None
) -> sk.Layout:
    """Return a layout by its name, or read it from a file.

    Parameters
    ----------
    layout : str, path or Layout
        The name of a built-in layout; the path of a layout file; that of a file whose skeleton
        `read_skeleton` reads, such as SLEAP's or DeepLabCut's detections or DeepLabCut's ``config.yaml``; or
        ``"file"``, the skeleton of the detections. The pairs of such a skeleton are those that its names
        state, and a note says which.
    detections : path, optional
        For ``"file"``.

    Raises
    ------
    InvalidInputError
        If there is no layout of this name.
    DatasetError
        If a file cannot be read, or its joints have no names.
    """
    if layout == OF_FILE:
        if detections is None:
            raise InvalidInputError("layout: expected a name or a path, as there are no detections, got file")
        return _of_skeleton(*read_skeleton(detections), Path(detections))
    file = _skeleton_file(layout)
    return sk.layouts.get(layout) if file is None else _of_skeleton(*read_skeleton(file), file)


def _of_skeleton(names: Sequence[str], edges: Sequence[tuple[int, int]], path: Path) -> sk.Layout:
    try:
        name = path.resolve().stem
        name = f"{name}_file" if name in sk.layouts.names else name
        layout = sk.layouts.from_names(name, names, edges)
    except InvalidInputError as error:
        raise DatasetError.of_argument(path, error) from error
    pairs = [f"{names[left]}–{names[right]}" for left, right in layout.left_right]
    numbers = {"joints": len(names), "limbs": len(edges), "pairs": pairs}
    named = f"{len(pairs)} left–right pairs by name ({listed(pairs, _MOST_PAIRS) or 'none'})"
    words = f"The layout is that of {path}: {len(names)} joints, {len(edges)} limbs, {named}."
    warn(Finding("layout_of_file", "note", Subject(files=(str(path),)), numbers, sentence=words))
    return layout


def choose_layout(
    layout: str | os.PathLike[str] | sk.Layout | None, views: Collection[View], detections: Path
) -> sk.Layout:
    """Return the layout that is asked for, or the one that names or number of the joints tell."""
    if layout == OF_FILE:
        first, edges = read_skeleton(detections)
        # of csv files, one camera's may lack a joint; the views have those of all (`_csv.completed`)
        most = max((view.joints or () for view in views), key=len, default=())
        everywhere = all(set(most) <= set(view.joints or ()) for view in views)
        return _of_skeleton(most if everywhere and set(most) > set(first) else first, edges, detections)
    if layout is not None:
        return read_layout(layout)
    hint = "the files hold no person to count joints of"
    for view in views:
        named = [known for known in known_layouts() if view.joints and _same_joints(known, view.joints)]
        if len(named) == 1:
            return named[0]
        if view.joints and not view.own_order:
            hint = f"{view.path} names {listed(view.joints, _SHOWN)}: {_named_layouts(view.joints)}"
            break
        counted = _count(view)
        if counted:
            path, joints = counted
            of_count = [known for known in known_layouts() if known.n_joints == joints in _COUNTED]
            if len(of_count) == 1 and (view.joints is None or confirmed(view.joints, of_count[0])):
                return of_count[0]
            names = f"; it names {listed(view.joints, _SHOWN)}" if view.joints else ""
            hint = f"{path} has {joints} joints per person: {layouts_of(joints)}{names}{advice_on(joints)}"
            break
    raise InvalidInputError(f"layout: expected a joint layout's name or file, got none; {hint}")


def _same_joints(layout: sk.Layout, names: Sequence[str]) -> bool:
    return len(names) == layout.n_joints and {key(n) for n in names} == {key(n) for n in layout.joints}


def _count(view: View) -> tuple[Path, int] | None:
    """Return the file that says how many joints a person has, and the number; None without a person."""
    if view.joints is not None:
        return view.path, len(view.joints)
    people = (person for number in view.frames for person in view.people(number))
    first = next((person for person in people if len(person.joints)), None)
    return None if first is None else (first.path, len(first.joints))


def _named_layouts(names: Sequence[str]) -> str:
    """Say which known layouts have all their joints among the names, or what to do if none has."""
    there = {key(name) for name in names}
    fitting = [layout.name for layout in known_layouts() if there.issuperset(map(key, layout.joints))]
    if fitting:
        return f"all joints of {' or '.join(fitting)}{_AS_NAMED}"
    return f"{UNKNOWN} has all its joints among them{_AS_NAMED}{CUSTOM}"
