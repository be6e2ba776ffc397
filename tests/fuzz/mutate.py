"""Valid files made invalid: bytes, text, JSON trees and archives of arrays."""

from __future__ import annotations

import io
import json
import re
import zipfile
from collections.abc import Callable
from random import Random
from typing import Any

import numpy as np

NUMBERS = (
    "nan NaN inf -inf Infinity 1e308 -1e308 1e-320 1e999 -1 0 -0.0 1 2 5.5 2147483648 9223372036854775808"
)
MARKS = "true null '' \"\" [] {} [[1],[1,2]] \x1b[31m \u202e ² ٣ ../../etc/passwd %s \\ # \0"
WORDS = (*NUMBERS.split(), *MARKS.split(" "), "1" * 400, "é" * 300, "\r\n", "a" * 3000)
LISTS: tuple[Any, ...] = ([], {}, [[1, 2], [3]], {"a": 1}, [[]], [None])
TEXTS = ("", "x", "nan", "1e999", "\x1b]0;x\x07", "a\nb", "²", "é" * 300)
ODD = (None, True, -1, 0, 3, 5.5, 2**31, 2**64, -(2**63), 10**400, 1e308, 1e-320, float("nan"), float("inf"))
VALUES: tuple[Any, ...] = (*ODD, *TEXTS, *LISTS)
INTEGERS = (0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0xFFFFFFFF, 2**63 - 1, 2**64 - 1)
_NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?")
_WORD = re.compile(r"[^\W\d]\w*")


def file(rng: Random, data: bytes, name: str) -> bytes:
    """Return a file with one to four changes of kinds that suit it."""
    kinds: list[Callable[[Random, bytes], bytes]] = [raw]
    if data[:4] == b"PK\3\4":
        kinds += [archive] * 3
    elif b"\0" not in data[:1000]:
        kinds += [text] * 2 + [tree] * (3 if name.endswith("json") else 0)
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        data = rng.choice(kinds)(rng, data)
    return data


def _part(rng: Random, data: bytes | str | list[str]) -> slice:
    start = rng.randrange(len(data) + 1)
    return slice(start, start + min(int(rng.expovariate(0.05)) + 1, 2000))


def raw(rng: Random, data: bytes) -> bytes:
    """Flip bits, set integers, cut, delete, repeat or insert bytes anywhere."""
    changed, part = bytearray(data), _part(rng, data)
    match rng.randrange(7):
        case 0 | 1:
            for _ in range(rng.choice((1, 1, 4, 16)) if data else 0):
                changed[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
        case 2:
            size, order = rng.choice((1, 2, 4, 8)), rng.choice(("little", "big"))
            number = rng.choice(INTEGERS) % 256**size
            changed[part.start : part.start + size] = number.to_bytes(size, order)  # type: ignore[arg-type]
        case 3:
            del changed[rng.choice((part.start, rng.randrange(64))) :]
        case 4:
            del changed[part]
        case 5:
            changed[part.start : part.start] = changed[part] * rng.choice((1, 2, 50))
        case _:
            changed[part.start : part.start] = rng.choice(WORDS).encode()
    return bytes(changed)


def text(rng: Random, data: bytes) -> bytes:
    """Replace numbers and words, rename, repeat, delete and exchange lines."""
    words = data.decode("latin-1")
    lines = words.splitlines(keepends=True)
    match rng.randrange(6):
        case 0 | 1:
            words = _replaced(rng, words, _NUMBER, rng.choice(WORDS))
        case 2:
            words = _replaced(rng, words, _WORD, rng.choice((*WORDS, *_WORD.findall(words)[:50])))
        case 3:
            del lines[_part(rng, lines)]
            words = "".join(lines)
        case 4:
            part = _part(rng, lines)
            words = "".join([*lines[: part.stop], *lines[part], *lines[part.stop :]])
        case _:
            mark = rng.choice(list("[]{}\",:=\n<>/ \t;#'&"))
            words = _replaced(
                rng, words, re.compile(re.escape(mark)), rng.choice(("", mark * 2, mark * 2000, ","))
            )
    return words.encode("latin-1", "ignore" if words.isascii() else "replace")


def _replaced(rng: Random, words: str, pattern: re.Pattern[str], by: str) -> str:
    found = list(pattern.finditer(words))
    if not found:
        return words
    match = rng.choice(found)
    return words[: match.start()] + by + words[match.end() :]


def tree(rng: Random, data: bytes) -> bytes:
    """Change one place of a JSON document."""
    try:
        document = json.loads(data)
    except (ValueError, RecursionError):
        return text(rng, data)
    holder = [document]
    _change_somewhere(rng, holder)
    try:
        return json.dumps(holder[0] if holder else None).encode()
    except ValueError:  # an integer with more digits than Python writes
        return data


def _places(value: Any) -> list[tuple[Any, Any]]:
    """Every list and table with each of its keys, of a long list some."""
    keys: Any = list(value) if isinstance(value, dict) else range(len(value))
    found = [(value, key) for key in keys]
    inner = [value[key] for key in (keys if len(keys) < 20 else [*keys[:10], *keys[-5:]])]
    for one in inner:
        if isinstance(one, dict | list):
            found += _places(one)
    return found


def _change_somewhere(rng: Random, holder: list[Any]) -> None:
    where, key = rng.choice(_places(holder))
    match rng.randrange(7):
        case 0 | 1 | 2:
            where[key] = rng.choice(VALUES)
        case 3:
            del where[key]
        case 4:
            where[key] = [where[key]] * rng.choice((1, 2, 300))
        case 5 if isinstance(where, dict):
            where[rng.choice([*WORDS, *where])] = where.pop(key)
        case _:
            other, name = rng.choice(_places(holder))
            where[key] = json.loads(json.dumps(other[name]))


def archive(rng: Random, data: bytes) -> bytes:
    """Change a member of a zip archive whose checksums stay right, its name, or which there are."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as opened:
            members = {name: opened.read(name) for name in opened.namelist()}
    except Exception:  # it was changed before
        return raw(rng, data)
    if not members:
        return raw(rng, data)
    name = rng.choice(list(members))
    match rng.randrange(8):
        case 0:
            del members[name]
        case 1:
            members[rng.choice([*(f"{word[:99]}.npy" for word in WORDS), *members])] = members.pop(name)
        case 2 | 3:
            members[name] = raw(rng, members[name])
        case _:
            members[name] = _array(rng, members[name])
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", rng.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED))) as written:
        for key, content in members.items():
            written.writestr(key.replace("\0", "0") or "x", content)
    return out.getvalue()


def _array(rng: Random, member: bytes) -> bytes:
    try:
        found = np.load(io.BytesIO(member), allow_pickle=True)
    except Exception:  # it was changed before
        return raw(rng, member)
    out = io.BytesIO()
    with np.errstate(all="ignore"):
        np.save(out, odd_array(rng, found), allow_pickle=True)
    return out.getvalue()


def odd_array(rng: Random, array: np.ndarray) -> np.ndarray:
    """Return an array with other values, of another type or of another shape."""
    array = array.copy()
    numeric, choice = array.dtype.kind in "biuf", rng.randrange(9)
    if choice <= 3 and array.size and numeric:
        place = rng.choice((slice(None), rng.randrange(array.size), slice(0, None, 3)))
        value = rng.choice((np.nan, np.inf, -np.inf, 1e308, 1e200, 1e30, 1e-320, 0.0, -1.0, 5.5, 2.0**63))
        if array.dtype.kind != "f" and rng.random() < 0.5:
            array = array.astype(np.float64)
        array.reshape(-1)[place] = np.asarray(value).astype(array.dtype)
        return array
    if choice == 4 and numeric:
        return np.asarray(array * array.dtype.type(rng.choice((0, 1, 2, 100))))
    if choice <= 5:
        kinds = ("f4", "f2", "i8", "i1", "u8", "?", "c16", "U5", "S5", "O", ">f8", "M8[s]")
        kinds = kinds if numeric else kinds[:-1]  # text like b"0.977" to times ends the process in NumPy 2.4
        try:
            return array.astype(rng.choice(kinds))
        except (ValueError, TypeError, OverflowError, RuntimeError):
            return array.astype("O")
    axis = rng.randrange(array.ndim) if array.ndim else 0
    shapes: tuple[Callable[[], np.ndarray], ...] = (
        lambda: array[..., None],
        lambda: array.reshape(-1),
        lambda: array.T,
        lambda: array[:0] if array.ndim else array,
        lambda: np.repeat(array, rng.choice((0, 2, 5)), axis) if array.ndim else array,
        lambda: np.delete(array, 0, axis) if array.ndim and array.shape[axis] else array,
        lambda: array.reshape(-1)[0] if array.size else array,
        lambda: array[::-1] if array.ndim else array,
    )
    return np.asarray(rng.choice(shapes)())
