"""``skelsplat demo``: the whole method on the recording that ships with the package."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from skelsplat.cli import options
from skelsplat.cli.command import takes
from skelsplat.cli.refine import run_and_print
from skelsplat.cli.rows import rows
from skelsplat.io import sample
from skelsplat.run import Job
from skelsplat.run.folder import run_folder

# one each, since a run removes the files of an earlier one
_FOLDER, _FOLDER_OF_PEOPLE = "skelsplat-demo", "skelsplat-demo-people"
_OF_PEOPLE = (
    "One of the two main people was added to this recording by calculation (Pose2Sim's demonstration): their "
    "detections are not those of a detector."
)
_NOTE = "The sample has no ground truth: these errors measure agreement with the detections, not accuracy."


@takes(
    *rows(
        "Output",
        f"-o, --output FOLDER  Folder for the results. [{_FOLDER}, with --people {_FOLDER_OF_PEOPLE}]",
        output=Path,
    ),
    options.PAPER,
    *rows("Input", "--people  Refine the recording of two people and a bystander."),
    options.FRAME_BY_FRAME,
    *rows("Cameras", "--no-adjust  Use the cameras as calibrated: one was turned since."),
    options.THREADS,
    options.QUIET,
    options.AS_JSON,
)
def demo(
    *,
    output: Path | None = None,
    people: bool,
    frame_by_frame: bool,
    adjust: bool,
    quiet: bool,
    as_json: bool,
    **settings: Any,
) -> None:
    """Refine the recording that ships with the package: 4 cameras, 100 frames, OpenPose.

    The input is copied to FOLDER/input, as the files of a typical recording
    (calibration TOML, one folder of OpenPose JSON per camera), and read from
    there. The results are pose.npz, pose.csv, pose.trc, report.json, report.html,
    overview.png and weights.png, with --paper also heatmaps.png; with --people,
    a folder of them per person, and a page and a picture of everybody.

    One camera was turned after the calibration: its place is adjusted first, by the
    detections (with --people the recording does not tell which camera it is).

    [bold]Examples[/bold]

    skelsplat demo

    skelsplat demo --people

    skelsplat demo --no-adjust

    skelsplat demo --paper -o /tmp/demo-paper

    skelsplat demo -o /tmp/demo --json > report.json
    """
    output = output or Path(_FOLDER_OF_PEOPLE if people else _FOLDER)
    config = options.config_of(**settings)
    with run_folder(output):  # which another run may be writing
        paths = sample.extract(output / "input", people=people)
    job = Job(
        paths.calibration,
        paths.detections,
        unit=sample.UNIT,
        layout=sample.LAYOUT,
        fps=sample.FRAME_RATE_HZ,
        frame_by_frame=frame_by_frame,
        config=config,
        people="all" if people else None,
        adjust_cameras=adjust and not people,
        output=output,
        note=f"{_NOTE} {_OF_PEOPLE}" if people else _NOTE,
    )
    run_and_print(job, quiet=quiet, as_json=as_json)
