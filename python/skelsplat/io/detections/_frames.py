"""Which frames the cameras share, and where each camera's clock is set."""

from __future__ import annotations

import functools
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np

from skelsplat._arrays import Index, positive
from skelsplat._clocks import Clock, common_rate, one_rate, rounded
from skelsplat._fields import FRAME_LIMIT
from skelsplat.exceptions import DatasetError, InvalidInputError
from skelsplat.findings import Finding, Subject, warn
from skelsplat.io._files import frame_number, natural
from skelsplat.io.detections._format import View
from skelsplat.io.detections._match import camera_called

FrameMode = Literal["strict", "intersection", "union"]
FRAME_MODES = ("strict", "intersection", "union")
_FEW = 0.1  # of the frames: where more are missing, the numbers are not those of a whole recording
_NAMED = 3  # spans of missing frames that a message names
_SET_ASIDE = "del_"  # before the name of a JSON file that Pose2Sim's synchronisation cut off
_LAST = re.compile(r"\d+(?=\D*$)")  # the last integer in a name
_OTHER_MODES = '; frames="intersection" reads those that all have, frames="union" every frame'


def check_offsets(
    offsets: Mapping[str, float] | None, names: Sequence[str], clocks: Mapping[str, float]
) -> dict[str, float]:
    """Return offsets by camera, unless given those that put clocks right; names may be written loosely."""
    checked = {name: rounded(-clock) for name, clock in clocks.items()}
    written = dict[str, str]()
    for text, value in (offsets or {}).items():
        name = camera_called(text, names, "offsets")
        if name in written:
            raise InvalidInputError(f"offsets: expected {name} once, got {written[name]!r} and {text!r}")
        written[name] = text
        number = isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
        if not number or not abs(float(value)) < FRAME_LIMIT:
            expected = "a number of frames, fewer than 2^62"
            raise InvalidInputError(f"offsets[{name}]: expected {expected}, got {value!r:.40}")
        checked[name] = int(value) if value == int(value) else float(value)
    return checked


def check_rates(
    given: float | Mapping[str, float] | None,
    names: Sequence[str],
    views: Mapping[str, View],
    of_videos: Callable[[Mapping[str, View]], Mapping[str, float]],
) -> tuple[dict[str, float], str]:
    """Return frames per second by camera, as given or as files, or else videos, state them; and which."""
    if given is not None and not isinstance(given, Mapping):
        positive("fps", given)
        return dict.fromkeys(views, given), ""
    rates = {name: view.rate for name, view in views.items() if view.rate and view.rate > 0}
    for text, rate in (given or {}).items():
        name = camera_called(text, names, "fps")
        positive(f"fps[{name}]", rate)
        rates |= {name: float(rate)} if name in views else {}
    stated = "" if given else "files" if rates else "videos"
    rates = rates or dict(of_videos(views))
    lacking = [name for name in views if name not in rates]
    if lacking and (given or one_rate([*rates.values()]) is None) and rates:
        each = ", ".join(f"{name} {round(rate, 3):g}" for name, rate in rates.items())
        raise InvalidInputError(f"fps: expected that of {', '.join(lacking)} as well, got {each}")
    return rates, stated if rates else ""


def clocks_of(
    views: Mapping[str, View], offsets: Mapping[str, float], rates: Mapping[str, float]
) -> dict[str, Clock]:
    """Return the clock of each camera; they count from 1 if no frame has a smaller number, else from 0."""
    paces = common_rate([*rates.values()])[1] if rates else []
    pace = dict(zip(rates, paces, strict=True))
    first = min((int(view.frames[0]) for view in views.values() if len(view.frames)), default=0)
    return {name: Clock(offsets.get(name, 0), pace.get(name, 1.0), int(first == 1)) for name in views}


def is_uneven(views: Mapping[str, View], clocks: Mapping[str, Clock]) -> bool:
    """Say whether ``strict`` refuses the views because they do not have the same frames."""
    frames = {name: view.frames for name, view in views.items()}
    if any(clock.pace != 1.0 for clock in clocks.values()):
        frames = {name: replace(clocks[name], offset=0.0).numbers(own) for name, own in frames.items()}
        frames = dict(_overlapping(frames))
    sparse = any(view.sparse for view in views.values())
    return not sparse and not _alike([*frames.values()])


def shared_frames(
    root: Path,
    kind: str,
    views: Mapping[str, View],
    labels: Mapping[str, str],
    mode: str,
    clocks: Mapping[str, Clock],
) -> Index:
    """Return the ascending frame numbers to read, (T,), in the common time.

    ``strict`` asks for the same numbers in all views, after offsets from the latest beginning to the earliest
    end; of a format that lists only people it reads every frame that is listed anywhere.
    """
    common = {labels[name]: clocks[name].numbers(view.frames) for name, view in views.items()}
    given = ", ".join(f"{name}: {clock.offset}" for name, clock in clocks.items() if clock.offset)
    after = f" after the offsets ({given})" if given else ""
    moved = any(round(clock.offset) or clock.pace != 1.0 for clock in clocks.values())
    judged = _overlapping(common) if moved else common
    if mode == "strict" and is_uneven(views, clocks) and not _alike(list(judged.values())):
        expected = f"the same frames in every {kind}{after}"
        raise DatasetError(root, "frames", expected, _told(judged) + _OTHER_MODES)
    union, shared = _joined(np.union1d, common), _joined(np.intersect1d, common)
    if not len(union):
        raise DatasetError(root, "frames", "at least one frame", "none")
    if mode == "strict" and any(view.sparse for view in views.values()):
        together = np.sum([np.isin(union, own) for own in common.values()], axis=0) > 1
        alone = len(common) > 1 and not all(np.isin(own, union[together]).any() for own in common.values())
        shared = shared[:0] if alone else union
    if mode != "union" and not len(shared):
        raise DatasetError(root, "frames", f"frames that all {kind}s have{after}", _told(common))
    _warn_of_gaps({labels[name]: view.frames for name, view in views.items() if not view.sparse})
    return union if mode == "union" else shared


def _warn_of_gaps(frames: Mapping[str, Index]) -> None:
    """Warn of frames that some lack here and there within a recording of which they have most."""
    missing = dict[str, list[int]]()
    union = _joined(np.union1d, frames) if frames else np.empty(0, dtype=np.int64)
    for label, own in frames.items():
        gaps = np.setdiff1d(union[(union > own[0]) & (union < own[-1])], own) if len(own) else own
        if 0 < len(gaps) <= _FEW * len(own):
            missing[label] = gaps.tolist()
    if missing:
        each = ", ".join(f"{_numbers(numbers)} in {label}" for label, numbers in missing.items())
        subject = Subject(frames=tuple(sorted({frame for own in missing.values() for frame in own})))
        words = f"Frames without detections in the files: {each}."
        warn(Finding("frames_missing", "warning", subject, {"missing": missing}, sentence=words))


def _numbers(frames: Sequence[int]) -> str:
    """Return "3, 7 to 9", or of many the first and how many more."""
    starts = [k for k, frame in enumerate(frames) if not k or frame != frames[k - 1] + 1]
    spans = [(frames[a], frames[b - 1]) for a, b in pairwise([*starts, len(frames)])]
    words = [str(a) if a == b else f"{a} to {b}" for a, b in spans[:_NAMED]]
    more = sum(b - a + 1 for a, b in spans[_NAMED:])
    return ", ".join(words) + (f" and {more} more" if more else "")


def _alike(several: Sequence[Index]) -> bool:
    return all(np.array_equal(frames, several[0]) for frames in several)


def _joined(join: Any, frames: Mapping[str, Index]) -> Index:
    several = list(frames.values())
    return several[0] if _alike(several) else functools.reduce(join, several)


def _overlapping(frames: Mapping[str, Index]) -> Mapping[str, Index]:
    """Return what each has from the latest first frame of all to the earliest last one."""
    if not all(map(len, frames.values())):
        return frames
    first, last = max(own[0] for own in frames.values()), min(own[-1] for own in frames.values())
    return {label: own[(own >= first) & (own <= last)] for label, own in frames.items()}


def _told(frames: Mapping[str, Index]) -> str:
    """Say how many frames each has, and which is the first that one lacks."""
    counts = [f"{len(own)} in {name}" for name, own in frames.items()]
    spans = [f" ({own[0]} to {own[-1]})" if len(own) else "" for own in frames.values()]
    union = _joined(np.union1d, frames)
    lacking = {name: np.setdiff1d(union, own).tolist() for name, own in frames.items()}
    missing = [f"no frame {_numbers(numbers)} in {name}" for name, numbers in lacking.items() if numbers]
    return f"{', '.join(map(str.__add__, counts, spans))}; {', '.join(missing)}"


def frame_files(folder: Path, pattern: str, expected: str, advice: str = "") -> dict[int, Path]:
    """Files of a folder by frame number, the last integer in a name, ascending; `advice` is for none."""
    files: dict[int, Path] = {}
    for path in sorted(folder.glob(pattern)):
        if path.name.startswith("."):  # "._name" of macOS beside every file on foreign disks
            continue
        if path.name.startswith(_SET_ASIDE) and path.suffix == ".json":
            expected = f"a frame to read; delete or rename files {_SET_ASIDE}*, which Pose2Sim set aside"
            raise DatasetError(path, "file name", expected, f"{path.name!r}")
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
