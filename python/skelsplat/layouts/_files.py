"""Layout files: TOML with names of joints; what is missing follows from the names.

=================  ===========================================================================================
name               by default that of the file
joints             the names in the order of the arrays; all else may be left out
limbs              pairs of joints that are drawn connected, and whose distance stays the same
left_right         pairs (left, right) that are mirror images; by default those that their names say
symmetric          tables ``tier``, ``left``, ``right``: limbs of equal length; by default the mirrored limbs
bones              tables ``joints``, ``length_mm``, ``sigma_mm``: lengths of limbs that are known
angles             by name, tables ``joints`` (three or four), ``sign``, ``offset``: joint angles
occlusion_prone    joints
root               joints whose mean is the root
human              true: a person's body, with the built-in layouts' names of joints
about, detectors,  sentences for people
source
=================  ===========================================================================================
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from skelsplat._budget import read_toml
from skelsplat._escape import CONTROL
from skelsplat._fields import Field
from skelsplat._skelsplat import Layout
from skelsplat.exceptions import DatasetError, InvalidInputError

SUFFIX = ".toml"
_IN_A_LINE = 6
# Standard deviation of a bone's length if the file has none: a tenth of it, at most that of `RefineConfig`.
_SIGMA, _MOST_SIGMA_MM = 0.1, 20.0

_SIDES = {"l": "left", "r": "right", "left": "left", "right": "right"}
# Where a word has a side within, or begins with its letter.
_WITHIN = r"(?i:(?<=left)|(?<=right))(?=[A-Za-z])|(?<=^[LR])(?=[a-z])|(?<=[A-Za-z])(?=(?i:left|right))"
# The letter of a side alone: at the beginning, after or before the letter of a leg, at the end.
_LETTERS = ("^([lr])", "^[bfhm]([lr])", "([lr])[bfhm]$", "([lr])$")
# Beside such a letter, names in small letters have one of these: lip and rip are no pair.
_PARTS = re.compile(
    "ankle|antenna|arm|asi|brow|cheek|claw|ear|elb|eye|femur|fin|flank|foot|hand|heel|hip|hock|hoof|kne|leg|limb"
    "|mouth|nostril|paw|psi|pupil|shank|sho|tarsus|thigh|thumb|tibia|toe|whisker|wing|wri"
)
# Legs by their initials: FL and LF are the left front one.
_LEG = ("front", "hind", "back", "middle", "rear")
_LEGS = {code: f"{leg} {side}" for leg in _LEG for side in "lr" for code in (leg[0] + side, side + leg[0])}

Pair = tuple[int, int]


@dataclass(frozen=True)
class About:
    """What a layout is for, in words; all of it may be empty."""

    about: str = ""
    detectors: str = ""
    """The tools and models whose detections have these joints."""
    source: str = ""
    """Where the order of the joints is published."""


_WORDS = tuple(field.name for field in fields(About))
_LISTS = ("limbs", "left_right", "occlusion_prone", "root")
_KEYS = ("name", *_WORDS, "human", "joints", *_LISTS, "symmetric", "bones", "angles")


def about_of(document: Field) -> About:
    """Return what a document says in words."""
    return About(**{key: document[key].text() for key in _WORDS if key in document})


def read_file(path: Path) -> tuple[Layout, About]:
    """Return the layout of a file and what the file says of it, or raise `DatasetError`."""
    document = Field(path, "", read_toml(path)).table(_KEYS)
    given: dict[str, Any] = {key: _values(document[key]) for key in _LISTS if key in document}
    if "symmetric" in document:
        given["symmetric"] = [_symmetric(entry) for entry in document["symmetric"].entries()]
    bones = document["bones"].entries() if "bones" in document else []
    given["lengths"] = [bone for bone in map(_bone, bones) if bone is not None]
    angles = document["angles"].members() if "angles" in document else {}
    given["angles"] = [_angle(key, entry) for key, entry in angles.items()]
    name = document["name"].text() if "name" in document else path.stem
    joints, human = document["joints"].names(), document["human"].flag()
    try:
        return from_names(name, joints, human=human, **given), about_of(document)
    except InvalidInputError as error:
        named = error.of_argument(error.argument.replace("lengths", "bones"))
        raise DatasetError.of_argument(path, named) from error


def _values(field: Field) -> list[Any]:
    return [entry.value for entry in field.entries()]


def _symmetric(entry: Field) -> tuple[int, list[Any], list[Any]]:
    """Return the tier of two limbs and the limbs."""
    entry.table(("tier", "left", "right"))
    return entry["tier"].index(), _values(entry["left"]), _values(entry["right"])


def _bone(entry: Field) -> tuple[list[Any], float, float] | None:
    """Return the joints, length and its sigma of a bone; None without a length."""
    entry.table(("joints", "length_mm", "sigma_mm"))
    ends = _values(entry["joints"])
    if "length_mm" not in entry:
        return None
    length, sigma = entry["length_mm"].number(), entry["sigma_mm"]
    return ends, length, min(_SIGMA * length, _MOST_SIGMA_MM) if sigma.is_missing else sigma.number()


def _angle(name: str, entry: Field) -> tuple[str, list[str], float, float]:
    """Return name, joints, sign and offset of a joint angle."""
    entry.table(("joints", "sign", "offset"))
    sign = entry["sign"].number() if "sign" in entry else 1.0
    return name, entry["joints"].names(), sign, entry["offset"].number() if "offset" in entry else 0.0


def from_names(name: str, joints: Sequence[str], limbs: Sequence[Sequence[Any]] = (), **given: Any) -> Layout:
    """Return a layout whose mirror images and symmetric limbs are those that the joints' names state.

    `mirrored_names` reads the sides. Others of ``given`` are arguments of `Layout`.
    """
    if "left_right" not in given:
        given["left_right"] = mirrored_names(Layout(name, joints).joints)
    if "symmetric" not in given:
        given["symmetric"] = _mirrored_limbs(Layout(name, joints, limbs=limbs, **given))
    return Layout(name, joints, limbs=limbs, **given)


def mirrored_names(joints: Sequence[str]) -> tuple[Pair, ...]:
    """Return the pairs (left, right) of joints whose names differ only in the side.

    A side is a word or part of one: ``left_ear``, ``ear_l``, ``EarL``, ``Lear``, ``leftear``, ``hindright``,
    ``FL`` and ``RH`` (front left, right hind), in one joint only once. A joint without exactly one
    counterpart is in no pair. Paws that are numbered through, as ``paw1LF`` and ``paw2RF``, are pairs too.
    The first or last letter is a side, as of ``LASI`` or ``rfpaw``, if at least two pairs in capitals or of
    parts of the body have it there.
    """
    sides = [_side(name) for name in joints]
    legs = [side and tuple(word for word in side if not word.isdigit()) for side in sides]
    legs = [side if side and {*side} & {*_LEG} else None for side in legs]
    pairs = list({*_counterparts(sides), *_counterparts(legs)})
    for letter in _LETTERS:
        taken = {place for pair in pairs for place in pair}
        found = [None if k in taken or sides[k] else _lettered(name, letter) for k, name in enumerate(joints)]
        more = _counterparts(found)
        pairs += more if len(more) > 1 else []
    return tuple(sorted(pairs))


def _counterparts(sides: Sequence[tuple[str, ...] | None]) -> list[Pair]:
    """Return the pairs of sides with the same rest, each there once."""
    lone = {side: place for place, side in enumerate(sides) if side is not None and sides.count(side) == 1}
    left = ((place, lone.get(("right", *rest))) for (side, *rest), place in lone.items() if side == "left")
    return [(place, right) for place, right in left if right is not None]


def _lettered(name: str, letter: str) -> tuple[str, ...] | None:
    """Return the side that a letter of a name is, what is before it and after it; None if it is none."""
    found = re.search(letter, name.lower())
    if found is None:
        return None
    rest = name[: found.start(1)], name[found.end(1) :]
    return (_SIDES[found[1]], *rest) if name.isupper() or _PARTS.search("".join(rest).lower()) else None


def _side(name: str) -> tuple[str, ...] | None:
    """Return the side that a name states, and the rest of its words; None without a side, or with two."""
    words = re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+", name)
    if not any(word.lower() in _SIDES for word in words):
        words = [_LEGS.get(word.lower(), re.sub(_WITHIN, " ", word)) for word in words]
        words = " ".join(words).split()
    at = [k for k, word in enumerate(words) if word.lower() in _SIDES]
    if len(at) != 1 or len(words) == 1:
        return None
    return (_SIDES[words.pop(at[0]).lower()], *(word.lower() for word in words))


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

    def row(places: Iterable[int]) -> list[str]:
        return [_quoted(names[k]) for k in places]

    def pair(ends: Iterable[int]) -> str:
        return f"[{', '.join(row(ends))}]"

    words = {"name": layout.name, **vars(about or About())}
    tiers = [(tier, pair(left), pair(right)) for tier, left, right in layout.symmetric]
    lines = [f"{key} = {_quoted(text)}" for key, text in words.items() if text]
    lines += ["human = true", ""] if layout.human else [""]
    lines += [
        _list("joints", row(range(len(names)))),
        _list("limbs", [pair(limb) for limb in layout.limbs]),
        _list("left_right", [pair(both) for both in layout.left_right]),
        _list("symmetric", [f"{{ tier = {t}, left = {a}, right = {b} }}" for t, a, b in tiers]),
        _list("occlusion_prone", row(layout.occlusion_prone)),
        _list("root", row(layout.root)),
    ]
    for ends, length, sigma in layout.lengths:
        lines += ["", "[[bones]]", f"joints = {pair(ends)}", f"length_mm = {length}", f"sigma_mm = {sigma}"]
    lines += ["", "[angles]"] if layout.angles else []
    for called, joints, sign, offset in layout.angles:
        own = f"joints = {pair(joints)}, sign = {sign:g}, offset = {offset}"
        lines.append(f"{_quoted(called)} = {{ {own} }}")
    return "\n".join(lines) + "\n"


def _quoted(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + CONTROL.sub(lambda found: f"\\u{ord(found[0]):04x}", escaped) + '"'


def _list(key: str, items: Sequence[str]) -> str:
    if len(items) <= _IN_A_LINE:
        return f"{key} = [{', '.join(items)}]"
    rows = [", ".join(items[k : k + _IN_A_LINE]) for k in range(0, len(items), _IN_A_LINE)]
    return "\n".join([f"{key} = [", *(f"    {row}," for row in rows), "]"])
