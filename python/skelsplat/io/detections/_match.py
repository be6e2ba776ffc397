"""Which folder, file or part of a file belongs to which camera: by loosely written name or by order."""

from __future__ import annotations

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
_MOST_WORDS = 16  # of a name, of which each run is compared with those of all others
_WORDS = re.compile(r"\d+|[^\W\d_]+")
_CAPITAL = re.compile(r"(?<=[a-z])(?=[A-Z])")  # where camA is two words
_ADVICE = (
    "name each {kind} like its camera, for example {first}{tail} for the camera {first}, "
    'or state their order: order="sorted", or order= with the {kind} of each camera'
)


def camera_called(text: str, names: Sequence[str], argument: str = "camera") -> str:
    """Return the camera that is meant by `text`: exactly its name, or the only one that reads the same."""
    known = ", ".join(names)
    fitting = [text] if text in names else [name for name in names if _words(name) == _words(text)]
    if len(fitting) > 1:
        raise InvalidInputError(f"{argument}: expected the exact name of one of {known}, got {text!r}")
    if not fitting:
        raise InvalidInputError(f"{argument}: expected a camera, one of {known}, got {text!r}")
    return fitting[0]


def cameras_called(texts: Iterable[str], names: Sequence[str], argument: str) -> tuple[str, ...]:
    """Return the cameras that `texts`, or one text, mean, each once, in order, as `camera_called` does."""
    texts = [texts] if isinstance(texts, str) else texts
    return tuple(dict.fromkeys(camera_called(text, names, argument) for text in texts))


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
    within: bool = False  # the camera's words may stand among others in the text

    def __post_init__(self) -> None:
        longest = max(map(len, self.texts.values()), default=0)
        if len(self.texts) > MOST_CAMERAS or longest > MOST_NAME:
            expected = f"at most {MOST_CAMERAS}, with names of at most {MOST_NAME} characters"
            raise self.error(expected, f"{len(self.texts)}, with names of at most {longest}")

    def error(self, expected: str, actual: str) -> DatasetError:
        """Return the error that they do not fit the cameras."""
        return DatasetError(self.root, f"{self.kind}s", expected, actual)


def match_by_name(
    candidates: Candidates,
    names: Sequence[str],
    *,
    allow_missing: bool,
    optional: Collection[str] = (),
    otherwise: str = "",
) -> dict[str, str | None]:
    """Assign a label to every camera name, in the order of `names`.

    A text that is exactly the camera's name comes first; otherwise both are compared in lower case, without
    separators, leading zeros and a last word "json": camera ``cam_01`` and folder ``cam01_json`` belong
    together. Then, if `Candidates.within`, the camera's words stand together among those of the text
    (``take2_cam01_results`` and ``cam_01``), if that is so for one text alone. Last, either may have words
    around what names the camera (``int_cam01_img`` and ``cam01_json``, ``A`` and ``vid_camA``), if each fits
    nothing else. The match must be one to one; a camera without a label gets None if `allow_missing` or it is
    `optional`, and a label without a camera must be idle. `otherwise` says what else may be done
    where some lack a label.
    """
    kind, texts = candidates.kind, candidates.texts
    tail = PurePath(next(iter(texts), "")).suffix if kind == "file" else ""
    advice = _ADVICE.format(kind=kind, first=names[0], tail=tail)
    if not texts:
        raise candidates.error(f"one {kind} per camera ({', '.join(names)})", f"no {kind}s")
    found = {name: _label_of(candidates, name, names, advice) for name in names}
    found |= _around(candidates, names, found)
    taken = list(found.values())
    twice = [name for name in names if found[name] and taken.count(found[name]) > 1]
    if twice:
        actual = f"{found[twice[0]]} for {', '.join(twice)}; {advice}"
        raise candidates.error(f"one {kind} per camera", actual)
    stray = [label for label in texts if label not in taken and label not in candidates.idle]
    if stray:
        expected = f"a camera in the calibration for every {kind} (it has {', '.join(names)})"
        raise candidates.error(expected, f"no camera for {', '.join(stray)}; {advice}")
    missing = [name for name in names if found[name] is None]
    needed = [name for name in missing if not (allow_missing or name in optional)]
    if needed or len(missing) == len(names):
        expected = f"a {kind} for every camera ({kind}s: {', '.join(texts)})"
        advice += f"; {otherwise}" if otherwise and len(missing) < len(names) else ""
        raise candidates.error(expected, f"none for {', '.join(needed or missing)}; {advice}")
    return found


def _label_of(candidates: Candidates, name: str, names: Sequence[str], advice: str) -> str | None:
    """Return the one label that fits `name`, an idle one only if no other does; None if there is none."""
    texts, kind = candidates.texts, candidates.kind
    busy = {label: text for label, text in texts.items() if label not in candidates.idle}
    idle = {label: text for label, text in texts.items() if label in candidates.idle}
    within = candidates.within
    fitting = _fitting(busy, name, names, within=within) or _fitting(idle, name, names, within=within)
    rivals = [other for other in names if _words(other) == _words(name) and other not in texts.values()]
    if len(fitting) > 1 or (fitting and name in rivals and len(rivals) > 1):
        who = f"cameras {', '.join(rivals)}" if len(rivals) > 1 else f"camera {name}"
        actual = f"{who} and {kind}s {', '.join(fitting)} that read the same; {advice}"
        raise candidates.error(f"one {kind} per camera", actual)
    return fitting[0] if fitting else None


def _fitting(texts: Mapping[str, str], name: str, names: Sequence[str], *, within: bool) -> list[str]:
    """Return the labels that fit a camera's name best."""
    exact = [label for label, text in texts.items() if text == name]
    if exact:
        return exact
    words = _words(name)
    free = {label: _words(text) for label, text in texts.items() if text not in names}
    alike = [label for label, key in free.items() if key == words]
    if alike or not within:
        return alike
    return [label for label, key in free.items() if _is_within(words, key)]


def _around(
    candidates: Candidates, names: Sequence[str], found: Mapping[str, str | None]
) -> dict[str, str | None]:
    """Return labels for cameras without one: of words around one name, and around no other.

    A pair fits if one's words stand together among the other's, or if both share words that hold all in which
    they differ from the others of their kind.
    """
    taken = set(found.values())
    if None not in taken:
        return {}
    busy = [label for label in candidates.texts if label not in candidates.idle]
    cameras = {name: _words(_CAPITAL.sub(" ", name)) for name in names}
    texts = {label: _words(_CAPITAL.sub(" ", candidates.texts[label])) for label in busy or candidates.texts}
    own_camera, own_text = _differing(cameras), _differing(texts)
    runs = {words: _runs(words) for words in (*cameras.values(), *texts.values())}
    fits = {
        (name, label)
        for name, here in cameras.items()
        for label, there in texts.items()
        if any(
            run in (here, there) or (_is_within(own_camera[name], run) and _is_within(own_text[label], run))
            for run in runs[here] & runs[there]
            if run in (here, there) or not "".join(run).isdigit()
        )
    }
    by_camera, by_label = Counter(name for name, _ in fits), Counter(label for _, label in fits)
    return {
        name: label
        for name, label in fits
        if by_camera[name] == by_label[label] == 1 and found[name] is None and label not in taken
    }


def _differing(group: Mapping[str, tuple[str, ...]]) -> dict[str, tuple[str, ...]]:
    """Return the words of each without those that all begin and end with; all words of one alone."""
    every = list(group.values())
    shortest = min(map(len, every)) - 1 if len(every) > 1 else 0
    first = next((i for i in range(shortest) if len({words[i] for words in every}) > 1), shortest)
    rest = max(shortest - first, 0)
    last = next((i for i in range(rest) if len({words[-1 - i] for words in every}) > 1), rest)
    return {key: words[first : len(words) - last] for key, words in group.items()}


def _runs(words: tuple[str, ...]) -> set[tuple[str, ...]]:
    """Return the runs of words, of a very long name those at its beginning."""
    count = min(len(words), _MOST_WORDS)
    return {words[i:j] for i in range(count) for j in range(i + 1, count + 1)}


def match_by_order(
    candidates: Candidates,
    names: Sequence[str],
    order: str | Sequence[str],
    *,
    left_out: Collection[str] = (),
    otherwise: str = "",
) -> dict[str, str | None]:
    """Assign a label by a stated order to every camera name that is not left out.

    `order` is the label of every camera, in the order of the cameras, or ``"sorted"``: the first label in
    natural order (2 before 10) belongs to the first camera. Where no file is called exactly so, it may be
    named without its suffix, or by the camera's part of its name (of DeepLabCut's files that before "DLC").
    Last, a label may be written as loosely as for `match_by_name`: ``cam_02`` for ``cam02_json``. Where there
    are as many labels as cameras that are not left out, they are theirs; otherwise they are all cameras', and
    those of the left out need not exist. `otherwise` says what else may be done where ``"sorted"`` finds
    fewer labels than cameras, but two.
    """
    kind = candidates.kind
    usable = sorted((label for label in candidates.texts if label not in candidates.idle), key=natural)
    if isinstance(order, str):
        if order != SORTED:
            raise InvalidInputError(f'order: expected "{SORTED}" or a list of {kind}s, got {order!r}')
        names = _meant(names, left_out, len(usable))
        if len(usable) != len(names):
            expected = f"{len(names)} {kind}s for the cameras {', '.join(names)}"
            got = f"{len(usable)} ({', '.join(usable) or 'none'})"
            if otherwise and 2 <= len(usable) < len(names):
                got += f"; {otherwise}"
            raise candidates.error(expected, got)
        return {name: label for name, label in zip(names, usable, strict=True) if name not in left_out}
    wanted = [str(label) for label in order]
    names = _meant(names, left_out, len(wanted))
    if len(wanted) != len(names) or len(set(wanted)) != len(wanted):
        expected = f"{len(names)} different {kind}s, one per camera ({', '.join(names)})"
        raise InvalidInputError(f"order: expected {expected}, got {', '.join(wanted) or 'none'}")
    pairs = zip(names, wanted, strict=True)
    found = {name: _stated(candidates, label) for name, label in pairs if name not in left_out}
    if len(set(found.values())) != len(found):
        expected = f"a different {kind} for each camera"
        raise InvalidInputError(
            f"order: expected {expected}, got {', '.join(wanted)}, of which two mean the same"
        )
    return dict(found)


def _meant(names: Sequence[str], left_out: Collection[str], count: int) -> Sequence[str]:
    """Return the cameras that so many labels belong to: those that are not left out, or all."""
    kept = [name for name in names if name not in left_out]
    return kept if count == len(kept) else names


def _stated(candidates: Candidates, label: str) -> str:
    """Return what a stated label means: exactly that, the one file of that name in part, or the one alike."""
    if label in candidates.texts:
        return label
    files = candidates.texts if candidates.kind == "file" else {}
    fitting = [known for known in files if label == known.rpartition(".")[0]]
    fitting = fitting or [known for known, part in files.items() if label == part]
    if not fitting and candidates.kind != "view":
        fitting = [known for known, text in candidates.texts.items() if _words(text) == _words(label)]
    if len(fitting) != 1:
        expected = f"the {candidates.kind} {label!r} that order names"
        raise candidates.error(expected, ", ".join(candidates.texts) or "none")
    return fitting[0]


def _is_within(words: tuple[str, ...], among: tuple[str, ...]) -> bool:
    return any(among[at : at + len(words)] == words for at in range(len(among) - len(words) + 1))
