"""The files that a run writes, and those in its folder from before: removed if a run wrote them, or named."""

from __future__ import annotations

import contextlib
import tempfile
from typing import TYPE_CHECKING, Any

import typer

from skelsplat._json import to_text
from skelsplat._optional import can_draw
from skelsplat.exceptions import DatasetError
from skelsplat.io._atomic import atomic_write_text
from skelsplat.io._run_files import CAMERAS, DETECTIONS, REPORT, UNFINISHED, files_of_run
from skelsplat.io.poses import POSE_FORMATS
from skelsplat.run.html import NAME as PAGE

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from skelsplat.run.job import Job

_PICTURES, _PAPERS_PICTURE = ("overview.png", "weights.png"), "heatmaps.png"
_POSSIBLE = (
    *(f"pose.{kind}" for kind in POSE_FORMATS),
    CAMERAS,
    DETECTIONS,
    *_PICTURES,
    _PAPERS_PICTURE,
    PAGE,
)
# of other commands, perhaps the work of hours
_OF_OTHERS = ("plots", "overlay")


def planned(job: Job) -> list[str]:
    """Return the names of the files that a run writes, but for its report: pictures need the extra viz."""
    wanted = {*(f"pose.{kind}" for kind in job.write), CAMERAS, DETECTIONS}
    if can_draw():
        wanted |= {*_PICTURES, *([_PAPERS_PICTURE] if job.paper else []), *([PAGE] if job.html else [])}
    return [name for name in _POSSIBLE if name in wanted]


def keep_input(job: Job, sources: Sequence[Path] = ()) -> None:
    """Refuse a folder for the results in which they would stand in the place, or in the midst, of the input.

    Parameters
    ----------
    job : Job
    sources : sequence of Path
        The files or folders of single cameras, once they are known.

    Raises
    ------
    typer.BadParameter
        If a file that the run reads has the name of one that it writes, or the folder is that of the
        detections, or of one camera's, or lies within the latter.
    """
    out, top = job.out.resolve(), job.detections.resolve()
    written = {(out / name).resolve() for name in (*_POSSIBLE, REPORT)}
    for path in (job.calibration, job.detections, job.init):
        if path is not None and path.resolve() in {out, *written}:
            raise _in_the_way(path)
    for path in sources:
        place = path.resolve()
        folder = place if place.is_dir() else place.parent
        if place in written or (folder != top and folder != top.parent and folder in {out, *out.parents}):
            raise _in_the_way(path)


def check_places(job: Job) -> None:
    """Raise `DatasetError` if a folder stands where a result goes, before the work."""
    for path in (job.out / name for name in (*planned(job), REPORT)):
        if path.is_dir():
            raise DatasetError(path, "--output", "a file or nothing in the place of a result", "a folder")


def _in_the_way(path: Path) -> typer.BadParameter:
    expected = "a folder in which nothing that the run reads is written over or mixed with results"
    return typer.BadParameter(f"expected {expected}, got that of {path}", param_hint="--output")


def begin_writing(folder: Path, report: dict[str, Any]) -> None:
    """Write the report as that of an unfinished run, and then remove the files that an earlier run lists.

    It lists what is there of the earlier run and what is not there yet: the rest no run has written so far.

    Raises
    ------
    DatasetError
        If one cannot be removed.
    """
    listed = set(files_of_run(folder) or ())
    earlier = [name for name in _POSSIBLE if name in listed and not (folder / name).is_dir()]
    new = {name for name in report["files"] if not (folder / name).exists()}
    files = [name for name in _POSSIBLE if name in {*earlier, *new}]
    atomic_write_text(folder / REPORT, to_text({UNFINISHED: True, **report, "files": files}))
    for path in (folder / name for name in earlier):
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            raise DatasetError(path, "file", "one of an earlier run that can be removed", reason) from error


def left_of_earlier(folder: Path) -> list[str]:
    """Return the folders there that show the run before, as other commands wrote them."""
    return [f"{name}/" for name in _OF_OTHERS if any((folder / name).glob("*"))]


@contextlib.contextmanager
def output_folder(folder: Path) -> Iterator[None]:
    """Make a folder and write into it once, so that a bad one is known before the work.

    If the block fails, the folders that were made and are still empty go again.

    Raises
    ------
    DatasetError
        If the folder cannot be made or written.
    """
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder):
                pass
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            raise DatasetError(folder, "--output", "a folder that can be written", reason) from error
        yield
    except BaseException:
        for path in missing:
            with contextlib.suppress(OSError):  # not empty, or never made
                path.rmdir()
        raise
