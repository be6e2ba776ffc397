"""Which frames the cameras share, and where each camera's clock is set."""

from __future__ import annotations

import functools
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np

from skelsplat._arrays import Index
from skelsplat._clocks import parted
from skelsplat._fields import FRAME_LIMIT
from skelsplat.exceptions import DatasetError, InvalidInputError
from skelsplat.io._files import frame_number, natural
from skelsplat.io.detections._format import View
from skelsplat.io.detections._match import camera_called

_LAST = re.compile(r"\d+(?=\D*$)")  # the last integer in a name
FrameMode = Literal["strict", "intersection", "union"]
FRAME_MODES = ("strict", "intersection", "union")


def check_offsets(offsets: Mapping[str, float] | None, names: Sequence[str]) -> dict[str, float]:
    """Return the offset of every camera, 0 unless given; cameras may be written loosely."""
    checked, written = dict[str, float](dict.fromkeys(names, 0)), dict[str, str]()
    for text, value in (offsets or {}).items():
        name = camera_called(text, names, "offsets")
        if name in written:
            raise InvalidInputError(f"offsets: expected {name} once, got {written[name]!r} and {text!r}")
        written[name] = text
        checked[name] = _offset(value, f"offsets[{name}]")
    return checked


def _offset(value: Any, argument: str) -> float:
    """Return a number of frames, a whole one as an int."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        raise InvalidInputError(f"{argument}: expected a number of frames, got {value!r}")
    if not abs(float(value)) < FRAME_LIMIT:
        raise InvalidInputError(f"{argument}: expected frames, fewer than 2^62, got {value!r:.40}")
    return int(value) if value == int(value) else float(value)


@dataclass(frozen=True)
class Sources:
    """The opened views of one recording, and the frames that they share.

    `kind` is what belongs to a camera ("folder", "file" or "view" of a file), `labels` what each camera was
    matched with, None for nothing; in `views` are the cameras that have detections.
    """

    root: Path
    kind: str
    labels: Mapping[str, str | None]
    views: Mapping[str, View]

    @property
    def sparse(self) -> bool:
        """Whether frames in which nobody was found are not listed."""
        return any(view.sparse for view in self.views.values())

    @functools.cached_property
    def uneven(self) -> bool:
        """Whether ``strict`` refuses the views because they do not have the same frames."""
        return not self.sparse and not _alike([self._own[name] for name in self.views])

    @functools.cached_property
    def _own(self) -> dict[str, Index]:
        """The numbers of each view's frames."""
        return {name: np.asarray(view.frames, dtype=np.int64) for name, view in self.views.items()}

    def shared(self, mode: str, offsets: Mapping[str, float]) -> Index:
        """Return the ascending frame numbers to read, (T,), in the common time.

        `offsets` are by camera: what is to be added to its own numbers to get the common time, of which
        the whole frames count here. ``strict``
        asks for the same numbers in all views: in the files, or after the offsets from the first frame that
        all have begun by to the last before one ends. Of a sparse format it reads every frame that is listed
        anywhere.
        """
        labels = {name: str(self.labels[name]) for name in self.views}
        own = {labels[name]: frames for name, frames in self._own.items()}
        whole = {name: parted(offsets[name])[0] for name in self.views}
        added = list(whole.values())
        common = {labels[name]: frames + whole[name] for name, frames in self._own.items()}
        judged = _between(common) if any(added) else own
        if mode == "strict" and self.uneven and not _alike(list(judged.values())):
            expected = f"the same frames in every {self.kind}{_after(offsets)}"
            actual = _difference(judged, ranges=any(added)) + ("" if any(added) else _shifted(self._own))
            raise DatasetError(self.root, "frames", expected, actual)
        union, shared = _union(common), _intersection(common)
        if not len(union):
            raise DatasetError(self.root, "frames", "at least one frame", "none")
        if mode == "strict" and self.sparse:
            shared = shared[:0] if any(_alone(label, common) for label in common) else union
        if mode != "union" and len(union) and not len(shared):
            expected = f"frames that all {self.kind}s have{_after(offsets)}"
            counts = _counts(common, ranges=any(added) or self.sparse)
            raise DatasetError(self.root, "frames", expected, counts)
        return union if mode == "union" else shared


def _alike(several: Sequence[Index]) -> bool:
    return all(np.array_equal(frames, several[0]) for frames in several)


def _union(frames: Mapping[str, Index]) -> Index:
    several = list(frames.values())
    return several[0] if _alike(several) else functools.reduce(np.union1d, several)


def _intersection(frames: Mapping[str, Index]) -> Index:
    several = list(frames.values())
    return several[0] if _alike(several) else functools.reduce(np.intersect1d, several)


def _alone(label: str, frames: Mapping[str, Index]) -> bool:
    """Say whether a source shares no frame with any other."""
    others = [other for name, other in frames.items() if name != label]
    return bool(others) and not any(np.isin(frames[label], other).any() for other in others)


def _after(offsets: Mapping[str, float]) -> str:
    """Return a clause: the offsets; "" without any."""
    given = [f"{name}: {frames}" for name, frames in offsets.items() if frames]
    return f" after the offsets ({', '.join(given)})" if given else ""


def _between(frames: Mapping[str, Index]) -> Mapping[str, Index]:
    """Return what each has from the latest first frame of all to the earliest last one."""
    if not all(map(len, frames.values())):
        return frames
    first, last = max(own[0] for own in frames.values()), min(own[-1] for own in frames.values())
    return {label: own[(own >= first) & (own <= last)] for label, own in frames.items()}


def _difference(frames: Mapping[str, Index], *, ranges: bool = False) -> str:
    first = np.setdiff1d(_union(frames), _intersection(frames))[0]
    without = ", ".join(name for name, own in frames.items() if first not in own)
    uneven = len({len(own) for own in frames.values()}) > 1
    there = _counts(frames, ranges=ranges) if uneven else f"equal counts but no frame {first} in {without}"
    return f'{there}; frames="intersection" reads those that all have, frames="union" every frame'


def _shifted(frames: Mapping[str, Index]) -> str:
    """Return a clause: the offsets of cameras whose frames begin at another number than most, or ""."""
    if not _alike([own - own[:1] for own in frames.values()]):
        return ""
    begins = [int(own[0]) for own in frames.values()]
    most = max(sorted(set(begins)), key=begins.count)
    offsets = {name: most - first for name, first in zip(frames, begins, strict=True) if first != most}
    return f"; if all begin at the same instant, offsets={offsets} numbers them alike"


def _counts(frames: Mapping[str, Index], *, ranges: bool = False) -> str:
    counts = {name: f"{len(own)} in {name}" for name, own in frames.items()}
    spans = {name: f" ({own[0]} to {own[-1]})" for name, own in frames.items() if ranges and len(own)}
    return ", ".join(count + spans.get(name, "") for name, count in counts.items())


def frame_files(folder: Path, pattern: str, expected: str, advice: str = "") -> dict[int, Path]:
    """Files of a folder by frame number, the last integer in a name, ascending; `advice` is for none."""
    files: dict[int, Path] = {}
    for path in sorted(folder.glob(pattern)):
        if path.name.startswith("."):  # "._name" of macOS beside every file on foreign disks
            continue
        digits = re.findall(r"\d+", path.stem)
        if not digits:
            raise DatasetError(path, "file name", "a frame number in it", f"{path.name!r}")
        number = frame_number(path, "file name", digits[-1])
        if number in files:
            rule = f"one file for frame {number} (the last integer in the name)"
            raise DatasetError(path, "file name", rule, f"also {files[number].name}")
        files[number] = path
    if not files:
        raise DatasetError(folder, "files", expected, f"no {pattern.lstrip('*')} files{advice}")
    files = dict(sorted(files.items()))
    _check_one_recording(files)
    return files


def _check_one_recording(files: Mapping[int, Path]) -> None:
    """Raise `DatasetError` if names differ beside the frame's number, and not in its order, as times do."""
    rests = {path: _LAST.sub("*", path.stem) for path in files.values()}
    kinds = len(set(rests.values()))
    if kinds <= 1:
        return
    for (first, here), (second, there) in pairwise(rests.items()):
        if natural(here) >= natural(there) if kinds == len(rests) else here != there:
            expected = "names that differ in the frame's number alone (the last integer), or in its order"
            raise DatasetError(second, "file name", expected, f"{second.name!r} after {first.name!r}")
