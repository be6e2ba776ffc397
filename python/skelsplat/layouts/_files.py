"""Layout files: TOML with names of joints; what is missing follows from the names.

=================  ===========================================================================================
name               by default that of the file
joints             the names in the order of the arrays; all else may be left out
limbs              pairs of joints that are drawn connected, and whose distance stays the same
left_right         pairs (left, right) that are mirror images; by default those that their names say
symmetric          tables ``tier``, ``left``, ``right``: limbs of equal length; by default the mirrored limbs
bones              tables ``joints``, ``length_mm``, ``sigma_mm``: lengths of limbs that are known
occlusion_prone    joints
root               joints whose mean is the root
human              true: a person's body, with the built-in layouts' names of joints
about, detectors,  sentences for people
source
=================  ===========================================================================================
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from skelsplat._budget import read_toml
from skelsplat._escape import CONTROL
from skelsplat._skelsplat import Layout
from skelsplat.exceptions import DatasetError, InvalidInputError

SUFFIX = ".toml"
_WIDTH = 100
# Standard deviation of a bone's length if the file has none: a tenth of it, at most that of `RefineConfig`.
_SIGMA, _MOST_SIGMA_MM = 0.1, 20.0

Pair = tuple[int, int]


@dataclass(frozen=True)
class About:
    """What a layout is for, in words; all of it may be empty.

    Attributes
    ----------
    about
        What it is.
    detectors
        The tools and models whose detections have these joints.
    source
        Where the order of the joints is published.
    """

    about: str = ""
    detectors: str = ""
    source: str = ""


_WORDS = tuple(field.name for field in fields(About))
_PARTS = ("joints", "limbs", "left_right", "symmetric", "bones", "occlusion_prone", "root")
_KEYS = ("name", *_WORDS, "human", *_PARTS)


def hint_at(name: str, known: Sequence[str]) -> str:
    """Return "; did you mean …?" with the closest of the known names, empty if none is close."""
    from difflib import get_close_matches

    close = get_close_matches(name, known, n=1)
    return f"; did you mean {close[0]}?" if close else ""


def about_of(document: Mapping[str, Any]) -> About:
    """Return what a document says in words."""
    return About(**{key: str(document.get(key, "")) for key in _WORDS})


def read_file(path: Path) -> tuple[Layout, About]:
    """Return the layout of a file and what the file says of it, or raise `DatasetError`."""
    document = read_toml(path)
    for key in document:
        if key not in _KEYS:
            actual = f"an unknown key{hint_at(key, _KEYS)}"
            raise DatasetError(path, key, f"one of {', '.join(_KEYS)}", actual)
    for key, kind, expected in (
        *((key, str, "text") for key in ("name", *_WORDS)),
        ("human", bool, "true or false"),
        *((key, list, "a list") for key in _PARTS),
    ):
        if not isinstance(document.get(key, kind()), kind):
            raise DatasetError(path, key, expected, repr(document[key])[:60])
    if "joints" not in document:
        raise DatasetError(path, "joints", "the names of the joints", "nothing (the key is missing)")
    try:
        return _layout(path, document), about_of(document)
    except InvalidInputError as error:
        expected, _, actual = error.reason.removeprefix("expected ").rpartition(", got ")
        raise DatasetError(path, error.argument.replace("lengths", "bones"), expected, actual) from error


def _layout(path: Path, document: Mapping[str, Any]) -> Layout:
    keys = ("limbs", "left_right", "occlusion_prone", "root", "human")
    given = {key: document[key] for key in keys if key in document}
    if "symmetric" in document:
        tables = enumerate(document["symmetric"])
        given["symmetric"] = [
            tuple(_entry(path, f"symmetric[{k}]", table, tier=None, left=None, right=None))
            for k, table in tables
        ]
    lengths = (_bone(path, f"bones[{k}]", table) for k, table in enumerate(document.get("bones", ())))
    given["lengths"] = [bone for bone in lengths if bone is not None]
    return of_names(document.get("name") or path.stem, document["joints"], **given)


def of_names(name: str, joints: Sequence[str], **given: Any) -> Layout:
    """Return a layout; the pairs and symmetric limbs that are not given are those of the names."""
    if "left_right" not in given:
        given["left_right"] = mirrored_names(Layout(name, joints).joints)
    if "symmetric" not in given:
        given["symmetric"] = _mirrored_limbs(Layout(name, joints, **given))
    return Layout(name, joints, **given)


def _bone(path: Path, place: str, table: Any) -> tuple[Any, float, float] | None:
    """Return the joints, length and its sigma of a bone; None without a length."""
    ends, length, sigma = _entry(path, place, table, joints=None, length_mm=0.0, sigma_mm=0.0)
    for key, value in (("length_mm", length), ("sigma_mm", sigma)):
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise DatasetError(path, f"{place}.{key}", "a number of mm", repr(value)[:60])
        if key in table and value == 0:
            raise DatasetError(path, f"{place}.{key}", "a positive number of mm", value)
    if not length and not sigma:
        return None
    return ends, length, sigma or min(_SIGMA * length, _MOST_SIGMA_MM)


def _entry(path: Path, place: str, table: Any, **keys: Any) -> Iterator[Any]:
    """Yield the values under these keys of a table; a key without a default must be there."""
    if not isinstance(table, dict):
        raise DatasetError(path, place, f"a table of {', '.join(keys)}", repr(table)[:60])
    for key in table:
        if key not in keys:
            raise DatasetError(path, f"{place}.{key}", f"one of {', '.join(keys)}", "an unknown key")
    for key, default in keys.items():
        if default is None and key not in table:
            raise DatasetError(path, f"{place}.{key}", "a value", "nothing (the key is missing)")
        yield table.get(key, default)


def mirrored_names(joints: Sequence[str]) -> tuple[Pair, ...]:
    """Return the pairs (left, right) of joints whose names differ only in the side.

    A side is a word or part of one: ``left_ear``, ``ear_l``, ``EarL``, ``Lear``, ``leftear``, in one joint
    only once. A joint without exactly one counterpart is in no pair.
    """
    places: dict[tuple[str, ...], list[int]] = {}
    for place, name in enumerate(joints):
        side = _side(name)
        if side is not None:
            places.setdefault(side, []).append(place)
    lone = {key: at[0] for key, at in places.items() if len(at) == 1}
    left = ((at, lone.get(("right", *key[1:]))) for key, at in lone.items() if key[0] == "left")
    return tuple((at, right) for at, right in left if right is not None)


def _side(name: str) -> tuple[str, ...] | None:
    """Return the side that a name states, and the rest of its words; None without a side, or with two."""
    words = re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+", name)
    sides = {"l": "left", "r": "right", "left": "left", "right": "right"}
    at = [k for k, word in enumerate(words) if word.lower() in sides]
    if len(at) == 1:
        rest = [word.lower() for k, word in enumerate(words) if k != at[0]]
        return (sides[words[at[0]].lower()], *rest) if rest else None
    begun = [(k, re.match(r"(?i:left|right)(?=[a-z])|[LR](?=[a-z])", word)) for k, word in enumerate(words)]
    found = [(k, match[0]) for k, match in begun if match is not None]
    if at or len(found) != 1:
        return None
    k, side = found[0]
    words[k] = words[k][len(side) :]
    return (sides[side.lower()], *(word.lower() for word in words))


def _mirrored_limbs(layout: Layout) -> list[tuple[int, Pair, Pair]]:
    """Return the limbs whose mirror images are limbs: tier 1, and 3 where one end lies on the body's axis."""
    mirror = dict(layout.left_right) | {right: left for left, right in layout.left_right}
    left = {one for one, _ in layout.left_right}
    known = {frozenset(limb) for limb in layout.limbs}
    found = []
    for a, b in layout.limbs:
        image = (mirror.get(a, a), mirror.get(b, b))
        one_side = {a, b} & mirror.keys() <= left
        if one_side and {a, b} & left and frozenset(image) in known:
            found.append((1 if a in left and b in left else 3, (a, b), image))
    return found


def to_toml(layout: Layout, about: About | None = None) -> str:
    """Return a layout as the text of a layout file."""
    names = layout.joints

    def pair(ends: Sequence[int]) -> str:
        return f"[{', '.join(_quoted(names[k]) for k in ends)}]"

    words = {key: getattr(about or About(), key) for key in _WORDS}
    lines = [f"name = {_quoted(layout.name)}"]
    lines += [f"{key} = {_quoted(text)}" for key, text in words.items() if text]
    lines += ["human = true"] if layout.human else []
    lines += ["", *_list("joints", [_quoted(name) for name in names])]
    lines += _list("limbs", [pair(limb) for limb in layout.limbs])
    lines += _list("left_right", [pair(both) for both in layout.left_right])
    tiers = [(tier, pair(left), pair(right)) for tier, left, right in layout.symmetric]
    lines += _list("symmetric", [f"{{ tier = {t}, left = {a}, right = {b} }}" for t, a, b in tiers])
    for key in ("occlusion_prone", "root"):
        places = getattr(layout, key)
        lines += _list(key, [_quoted(names[k]) for k in places]) if places else []
    for ends, length, sigma in layout.lengths:
        lines += ["", "[[bones]]", f"joints = {pair(ends)}", f"length_mm = {length}", f"sigma_mm = {sigma}"]
    return "\n".join(lines) + "\n"


def _quoted(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + CONTROL.sub(lambda found: f"\\u{ord(found[0]):04x}", escaped) + '"'


def _list(key: str, items: Sequence[str]) -> Iterator[str]:
    """Yield the lines of ``key = [...]``, on one line if they fit."""
    whole = f"{key} = [{', '.join(items)}]"
    if len(whole) <= _WIDTH:
        yield whole
        return
    yield f"{key} = ["
    line = ""
    for item in items:
        if line and len(line) + len(item) + 2 > _WIDTH:
            yield line
            line = ""
        line = f"{line} {item}," if line else f"    {item},"
    yield from (line, "]")
