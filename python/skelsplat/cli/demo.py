"""``skelsplat demo``: the whole method on the recording that ships with the package."""

from __future__ import annotations

from pathlib import Path

import skelsplat as sk
from skelsplat.cli import options
from skelsplat.cli.refine import run_and_print
from skelsplat.io import sample
from skelsplat.run import Job
from skelsplat.run.folder import output_folder

_NOTE = "The sample has no ground truth: these errors measure agreement with the detections, not accuracy."


def demo(
    output: options.Out = Path("skelsplat-demo"),
    paper: options.Paper = False,
    frame_by_frame: options.FrameByFrame = False,
    threads: options.Threads = None,
    quiet: options.Quiet = False,
    as_json: options.AsJson = False,
) -> None:
    """Refine the recording that ships with the package: 4 cameras, 100 frames, OpenPose.

    The input is copied to FOLDER/input, as the files of a typical recording
    (calibration TOML, one folder of OpenPose JSON per camera), and read from
    there. The results are pose.npz, pose.csv, pose.trc, report.json, report.html,
    overview.png and weights.png, with --paper also heatmaps.png.

    [bold]Examples[/bold]

    skelsplat demo

    skelsplat demo --paper -o /tmp/demo-paper

    skelsplat demo -o /tmp/demo --json > report.json
    """
    with output_folder(output):
        paths = sample.extract(output / "input")
    settings = {} if threads is None else {"n_threads": threads}
    job = Job(
        paths.calibration,
        paths.detections,
        unit=sample.UNIT,
        layout=sample.LAYOUT,
        fps=sample.FRAME_RATE_HZ,
        frame_by_frame=frame_by_frame,
        config=sk.RefineConfig.paper(**settings) if paper else sk.RefineConfig(**settings),
        output=output,
        note=_NOTE,
    )
    run_and_print(job, quiet=quiet, as_json=as_json)
