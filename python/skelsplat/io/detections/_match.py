"""Which folder, file or part of a file belongs to which camera: by loosely written name or by order."""

from __future__ import annotations

import functools
import operator
import re
import unicodedata
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePath

from skelsplat._budget import MOST_CAMERAS, MOST_NAME
from skelsplat.exceptions import DatasetError, InvalidInputError
from skelsplat.io._files import natural

SORTED = "sorted"
_WORDS = re.compile(r"\d+|[^\W\d_]+")
_CAPITAL = re.compile(r"(?<=[a-z])(?=[A-Z])")  # where camA is two words


def camera_called(text: str, names: Sequence[str], argument: str = "camera") -> str:
    """Return the camera that is meant by `text`: exactly its name, or the only one that reads the same."""
    fitting = [text] if text in names else [name for name in names if _words(name) == _words(text)]
    if len(fitting) != 1:
        expected = f"{'the exact name of' if fitting else 'a camera,'} one of {', '.join(names)}"
        raise InvalidInputError(f"{argument}: expected {expected}, got {text!r}")
    return fitting[0]


def is_among(text: str, names: Iterable[str]) -> bool:
    """Whether one of these names reads the same."""
    return any(_words(name) == _words(text) for name in names)


def cameras_called(texts: Iterable[str], names: Sequence[str], argument: str) -> tuple[str, ...]:
    """Return the cameras that `texts`, or one text, mean, each once, in order, as `camera_called` does."""
    texts = [texts] if isinstance(texts, str) else texts
    return tuple(dict.fromkeys(camera_called(text, names, argument) for text in texts))


@functools.lru_cache(maxsize=2 * MOST_CAMERAS)
def _words(name: str) -> tuple[str, ...]:
    """Split a name into lower-case words and numbers, without separators, leading zeros and a last "json".

    Letters and digits are the same in every form of Unicode: macOS writes ``ü`` as two characters.
    """
    found = _WORDS.findall(unicodedata.normalize("NFKC", name).lower())
    words = [word.lstrip("0") or "0" if word.isdigit() else word for word in found]
    if len(words) > 1 and words[-1] == "json":
        words.pop()
    return tuple(words)


@dataclass(frozen=True)
class Candidates:
    """What may belong to cameras."""

    root: Path  # where they are, for messages
    kind: str  # "folder", "file" or "view"
    texts: Mapping[str, str]  # by label, as it is shown, the text to compare with a camera's name
    idle: Collection[str] = ()  # labels that may be left over; they are taken only where no other fits
    named: bool = True  # the texts are names, not only places in a file

    def __post_init__(self) -> None:
        longest = max(map(len, self.texts.values()), default=0)
        if len(self.texts) > MOST_CAMERAS or longest > MOST_NAME:
            expected = f"at most {MOST_CAMERAS}, with names of at most {MOST_NAME} characters"
            raise self.error(expected, f"{len(self.texts)}, with names of at most {longest}")

    @property
    def busy(self) -> list[str]:
        """The labels that belong to cameras."""
        return [label for label in self.texts if label not in self.idle]

    def error(self, expected: str, actual: str) -> DatasetError:
        """Return the error that they do not fit the cameras."""
        return DatasetError(self.root, f"{self.kind}s", expected, actual)


def match_by_name(
    candidates: Candidates, names: Sequence[str], *, optional: Collection[str] = (), otherwise: str = ""
) -> dict[str, str]:
    """Return the label of every camera name that has one, in the order of `names`.

    A text that is exactly the camera's name comes first, then one that reads the same (``cam_01`` and
    ``cam01_json``). Last, either may have words around the other (``int_cam01_img`` and ``cam01_json``, ``A``
    and ``vid_camA``), if each fits nothing else. A camera without a label must be `optional`, and a label
    without a camera idle. `otherwise` says what else may be done where some lack a label.
    """
    kind, texts = candidates.kind, candidates.texts
    if not candidates.named:
        expected = 'the order of its views (order="sorted", or the place of each camera)'
        actual = f"none; it has no names, only views {', '.join(texts)}"
        raise DatasetError(candidates.root, "cameras", expected, actual)
    if not texts:
        raise candidates.error(f"one {kind} per camera ({', '.join(names)})", f"no {kind}s")
    tail = PurePath(next(iter(texts))).suffix if kind == "file" else ""
    advice = (
        f"name each {kind} like its camera, for example {names[0]}{tail} for the camera {names[0]}, "
        f'or state their order: order="sorted", or order= with the {kind} of each camera'
    )
    found = _assigned(candidates, names, advice)
    stray = [label for label in candidates.busy if label not in found.values()]
    if stray:
        expected = f"a camera in the calibration for every {kind} (it has {', '.join(names)})"
        advice += f"; {otherwise}" if otherwise else ""
        raise candidates.error(expected, f"no camera for {', '.join(stray)}; {advice}")
    missing = [name for name in names if name not in found]
    needed = [name for name in missing if name not in optional]
    if needed or len(missing) == len(names):
        expected = f"a {kind} for every camera ({kind}s: {', '.join(texts)})"
        advice += f"; {otherwise}" if otherwise and found else ""
        raise candidates.error(expected, f"none for {', '.join(needed or missing)}; {advice}")
    return {name: found[name] for name in names if name in found}


def _assigned(candidates: Candidates, names: Sequence[str], advice: str) -> dict[str, str]:
    """Return the label of each camera that has one: first of those that are not idle, closest names first."""
    found: dict[str, str] = {}
    for labels in (candidates.busy, candidates.idle):
        for fits in (operator.eq, reads_alike, _is_around):
            free = [label for label in labels if label not in found.values()]
            pairs = [
                (name, label)
                for name in names
                if name not in found
                for label in free
                if fits(name, candidates.texts[label])
            ]
            by_name, by_label = Counter(name for name, _ in pairs), Counter(label for _, label in pairs)
            for name, label in pairs:
                if by_name[name] == by_label[label] == 1:
                    found[name] = label
                elif fits is not _is_around:
                    actual = f"{', '.join(by_name)} and {', '.join(by_label)} that read the same; {advice}"
                    raise candidates.error(f"one {candidates.kind} per camera", actual)
    return found


def reads_alike(name: str, text: str) -> bool:
    """Whether a camera and a text have the same words and numbers."""
    return _words(name) == _words(text)


def _is_around(name: str, text: str) -> bool:
    """Say whether the words of one stand together among those of the other."""
    few, many = sorted((_words(_CAPITAL.sub(" ", one)) for one in (name, text)), key=len)
    return any(many[at : at + len(few)] == few for at in range(len(many) - len(few) + 1))


def match_by_order(
    candidates: Candidates,
    names: Sequence[str],
    order: str | Sequence[str],
    *,
    left_out: Collection[str] = (),
    otherwise: str = "",
) -> dict[str, str]:
    """Return the label of every camera name that is not left out by a stated order.

    `order` is the label of every camera, or ``"sorted"``: in natural order (2 before 10). A file may be named
    without its suffix or what the tool added, and any label as loosely as for `match_by_name`. As many labels
    as cameras that are not left out are theirs; else they are all cameras'.
    """
    kind, kept = candidates.kind, [name for name in names if name not in left_out]
    if isinstance(order, str) and order != SORTED:
        raise InvalidInputError(f'order: expected "{SORTED}" or a list of {kind}s, got {order!r}')
    wanted = sorted(candidates.busy, key=natural) if order == SORTED else [str(label) for label in order]
    names = kept if len(wanted) == len(kept) else names
    if order == SORTED and len(wanted) != len(names):
        got = f"{len(wanted)} ({', '.join(wanted) or 'none'})"
        got += f"; {otherwise}" if otherwise and 2 <= len(wanted) < len(names) else ""
        raise candidates.error(f"{len(names)} {kind}s for the cameras {', '.join(names)}", got)
    expected = f"{len(names)} different {kind}s, one per camera ({', '.join(names)})"
    refused = InvalidInputError(f"order: expected {expected}, got {', '.join(wanted) or 'none'}")
    if len(wanted) != len(names) or len({*wanted}) < len(wanted):
        raise refused
    pairs = zip(names, wanted, strict=True)
    found = {name: _stated(candidates, label) for name, label in pairs if name not in left_out}
    if len({*found.values()}) < len(found):
        raise refused
    return found


def _stated(candidates: Candidates, label: str) -> str:
    """Return what a stated label means: exactly that, or the one of that name in part or read alike."""
    texts = candidates.texts
    parts = [known for known, text in texts.items() if label in (known.rpartition(".")[0], text)]
    alike = [known for known, text in texts.items() if candidates.named and reads_alike(label, text)]
    fitting = [label] if label in texts else parts or alike
    if len(fitting) != 1:
        expected = f"the {candidates.kind} {label!r} that order names"
        raise candidates.error(expected, ", ".join(texts) or "none")
    return fitting[0]
