"""The folder of a run as the page shows it: numbers, findings, files."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from skelsplat.exceptions import DatasetError
from skelsplat.io._files import load_json
from skelsplat.io._run_files import REPORT, UNFINISHED, is_run
from skelsplat.run.folder import PAGE

# What files are for, by the end of their names, in the order in which they are offered.
_ABOUT = {
    PAGE: "the report: a page with the pose in 3D",
    ".trc": "markers, for OpenSim, Mokka, Visual3D",
    ".c3d": "markers, for motion capture programs",
    ".bvh": "animation, for Blender, MotionBuilder, Unreal",
    ".glb": "animation, for Blender, Unity, the web",
    "strides.csv": "every stride of a walk",
    ".csv": "tables, for spreadsheets, R, MATLAB",
    ".mot": "joint angles, for OpenSim",
    ".mp4": "the pose drawn on the videos",
    ".npz": "arrays, for Python",
    ".nc": "arrays, for xarray and movement",
    ".npy": "an array, as FreeMoCap writes it",
    ".png": "a picture",
    ".json": "for programs",
}


@dataclass(frozen=True)
class Result:
    """A run's folder, its report, and what the page compares of two of them."""

    folder: Path
    report: Mapping[str, Any]

    @property
    def people(self) -> list[Mapping[str, Any]]:
        """The people of a run of several."""
        return list(self.report.get("people", ()))

    @property
    def findings(self) -> list[tuple[str, Mapping[str, Any]]]:
        """What concerns the run, errors first, each after whom it is of."""
        of_people = [(f"Person {one['id']}: ", found) for one in self.people for found in one["findings"]]
        found = [*(("", one) for one in self.report["findings"]), *of_people]
        return sorted(found, key=lambda one: ("error", "warning", "note").index(one[1]["severity"]))

    @property
    def numbers(self) -> dict[str, str]:
        """What tells whether a run is good, in words."""
        if self.people:
            rows = {f"Person {one['id']}: error": px(one["median_error_px"]) for one in self.people}
            return {"Frames": str(self.report["input"]["frames"]), **rows, **self._doubts}
        total, states = self.report["reprojection_error"]["all"], self.report["joint_statuses"]
        joints = sum(states.values()) or 1
        return {
            "Frames": str(self.report["input"]["frames"]),
            "Error in the images": px(total["after_px"]),
            "Detections rejected": percent(total["rejected_share"]),
            "Joints well determined": percent(states.get("ok", 0) / joints),
            **self._doubts,
        }

    @property
    def _doubts(self) -> dict[str, str]:
        return {"Warnings": str(sum(one["severity"] != "note" for _, one in self.findings))}

    @property
    def compared(self) -> dict[str, str]:
        """The numbers, and the error of each camera."""
        cameras = self.report.get("reprojection_error", {}).get("cameras", ())
        return {**self.numbers, **{f"Error of {one['name']}": px(one["after_px"]) for one in cameras}}

    @property
    def videos(self) -> list[str]:
        """The videos with the pose drawn, that of all cameras first."""
        found = sorted(one.name for one in (self.folder / "overlay").glob("*.mp4"))
        return [f"overlay/{name}" for name in sorted(found, key=lambda name: name != "grid.mp4")]

    @property
    def files(self) -> list[tuple[str, str, int]]:
        """The files: name, what it is for, size in bytes."""
        places = [one for one in self.folder.rglob("*") if one.is_file() and self._own(one)]
        found = []
        for path in places:
            name = path.relative_to(self.folder).as_posix()
            about = next((words for end, words in _ABOUT.items() if name.endswith(end)), "")
            found.append((name, about, path.stat().st_size))
        order = [*_ABOUT.values(), ""]
        return sorted(found, key=lambda one: (order.index(one[1]), one[0]))

    def _own(self, path: Path) -> bool:
        """Whether a file is of the run; ``input`` has what a demo started from."""
        parts = path.relative_to(self.folder).parts
        inside = parts[0] in ("overlay", "opensim", "plots") or parts[0].startswith("person_")
        return not any(part.startswith(".") for part in parts) and (len(parts) == 1 or inside)


def px(value: float | None) -> str:
    """Return pixels in words."""
    return "–" if value is None else f"{value:.1f} px"


def percent(share: float | None) -> str:
    """Return a share in words."""
    return "–" if share is None else f"{100 * share:.1f} %"


def size_of(size: int) -> str:
    """Return a number of bytes in words."""
    return f"{size / 1e6:.1f} MB" if size >= 1e6 else f"{max(size / 1e3, 0.1):.1f} kB"


def read_result(folder: Path) -> Result | None:
    """Return the run in a folder; None if there is none that is whole."""
    if not is_run(folder):
        return None
    try:
        report = load_json(folder / REPORT, "the report of a run")
        result = Result(folder, report)
        return None if report.get(UNFINISHED) or not result.numbers else result
    except (DatasetError, KeyError, TypeError, AttributeError, ValueError):
        return None


def earlier_settings(report: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings of a run as they are typed, from its report."""
    made, found = report["input"], dict[str, Any]()
    for name in ("unit", "layout", "person", "sequence"):
        if made.get(name) not in (None, "consistent"):
            found[name] = str(made[name])
    if made.get("frame_rate_hz") and not made.get("frame_rate_from"):
        found["fps"] = f"{made['frame_rate_hz']:g}"
    if made.get("frame_mode") not in (None, "strict"):
        found["frames"] = made["frame_mode"]
    if made.get("adjust_cameras"):
        found["adjust_cameras"] = True
    if made.get("order"):
        found["order"] = made["order"] if isinstance(made["order"], str) else ",".join(made["order"])
    lists = {"without": made.get("without"), "offsets": [f"{k}={v}" for k, v in made.get("offsets", {}).items() if v]}
    found |= {name: list(texts) for name, texts in lists.items() if texts}
    if "people" in report:
        found.pop("person", None)
        found["people"] = "all"
    written = [name.partition(".")[2] for name in report["files"] if name.startswith(("pose.", "people."))]
    kinds = [kind for kind in written if kind != "npz"]
    return found | ({"write": ",".join(kinds)} if kinds else {})


class _Piece:
    """A stream that keeps what is written until it is taken."""

    def __init__(self) -> None:
        self.held, self.place = bytearray(), 0

    def write(self, data: bytes) -> int:
        """Keep bytes."""
        self.held += data
        self.place += len(data)
        return len(data)

    def tell(self) -> int:
        """Return how many bytes were written."""
        return self.place

    def flush(self) -> None:
        """Do nothing."""

    def take(self) -> bytes:
        """Return what was kept."""
        held = bytes(self.held)
        self.held.clear()
        return held


def zipped(result: Result) -> Iterator[bytes]:
    """Yield the files of a run as a zip file, in pieces: nothing is written to a disk."""
    stream = _Piece()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as packed:  # type: ignore[arg-type]
        for name, _, _ in result.files:
            with (result.folder / name).open("rb") as source, packed.open(name, "w", force_zip64=True) as target:
                while part := source.read(2**20):
                    target.write(part)
                    yield stream.take()
    yield stream.take()
