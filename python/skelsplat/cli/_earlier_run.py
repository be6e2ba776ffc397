"""What lies in a run's folder from before: removed, so that files of two runs are never mixed, or named."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skelsplat.cli._html_report import NAME as PAGE
from skelsplat.exceptions import DatasetError
from skelsplat.io.poses import POSE_FORMATS
from skelsplat.io.run_folder import CAMERAS, DETECTIONS, REPORT

if TYPE_CHECKING:
    from pathlib import Path

    from skelsplat.cli._job import Job

_PICTURES = ("overview.png", "weights.png", "heatmaps.png")
# the report first: without it nothing takes the folder for a whole run
_OF_A_RUN = (REPORT, PAGE, *_PICTURES, *(f"pose.{kind}" for kind in POSE_FORMATS), CAMERAS, DETECTIONS)
# of other commands, perhaps the work of hours
_OF_OTHERS = ("plots", "overlay")


def clear_earlier(job: Job) -> None:
    """Remove the files that an earlier run wrote into the folder, but for those that this run reads.

    Raises
    ------
    DatasetError
        If one cannot be removed.
    """
    given = {path.resolve() for path in (job.calibration, job.detections, job.init) if path is not None}
    for path in (job.out / name for name in _OF_A_RUN):
        if path.resolve() in given or path.is_dir():
            continue
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            raise DatasetError(path, "file", "one of an earlier run that can be removed", reason) from error


def left_of_earlier(folder: Path) -> list[str]:
    """Return the folders there that show the run before, as other commands wrote them."""
    return [f"{name}/" for name in _OF_OTHERS if any((folder / name).glob("*"))]
