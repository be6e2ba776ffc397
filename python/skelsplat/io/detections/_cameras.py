"""Which camera a name means that is written loosely."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from skelsplat.exceptions import InvalidInputError

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

_WORDS = re.compile(r"\d+|[^\W\d_]+")


def camera_called(text: str, names: Sequence[str], argument: str = "camera") -> str:
    """Return the camera that is meant by `text`: exactly its name, or the one that reads the same.

    Raises
    ------
    InvalidInputError
        If there is none, or more than one; names the `argument`.
    """
    known = ", ".join(names)
    fitting = [text] if text in names else [name for name in names if words_of(name) == words_of(text)]
    if len(fitting) > 1:
        raise InvalidInputError(f"{argument}: expected the exact name of one of {known}, got {text!r}")
    if not fitting:
        raise InvalidInputError(f"{argument}: expected a camera, one of {known}, got {text!r}")
    return fitting[0]


def cameras_called(texts: Iterable[str], names: Sequence[str], argument: str) -> tuple[str, ...]:
    """Return the cameras that are meant, each once, in the order of `texts`, as `camera_called` does."""
    return tuple(dict.fromkeys(camera_called(text, names, argument) for text in texts))


def words_of(name: str) -> tuple[str, ...]:
    """Split a name into lower-case words and numbers, without separators, leading zeros and a last "json"."""
    words = [word.lstrip("0") or "0" if word.isdigit() else word for word in _WORDS.findall(name.lower())]
    if len(words) > 1 and words[-1] == "json":
        words.pop()
    return tuple(words)
