"""``skelsplat overlay``: a run drawn on its videos."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import typer

import skelsplat as sk
from skelsplat._opencv import opencv
from skelsplat.cli import options
from skelsplat.cli.command import takes
from skelsplat.cli.findings import telling
from skelsplat.cli.output import print_json, progress, say
from skelsplat.cli.rows import rows
from skelsplat.findings import collected_warnings
from skelsplat.run.frame_range import FrameRange

EPILOG = (
    "Videos are MP4 with MPEG-4 part 2 (mp4v), which VLC and most players play but browsers do not; ffmpeg "
    "-i cam01.mp4 -c:v libx264 web.mp4 converts them. Needs pip install 'skelsplat\\[video]'."
)
OPTIONS = (
    *rows(
        "",
        """
        RUN  Output folder of refine or demo.
        VIDEOS  Folder with one video or one folder of images per camera, named like the camera; or one of
            them. Without any: --plain. [optional]
        """,
        run=Path,
        videos=Path,
    ),
    *rows(
        "Input",
        """
        --plain  Draw on plain frames of the cameras' size, without videos.
        --camera NAME  Camera to draw. Repeatable. [all]
        --order A,B,…  Video or folder of each camera, in the calibration's order, or sorted. [by name]
        --first-frame N  Number of a video's first frame in the files of the detections. Images are numbered
            by the last integer in their names. [0]
        """,
        camera={"name": "cameras", "many": True, "read": options.distinct},
        order=options.order,
        first_frame=int,
    ),
    *rows(
        "Drawing",
        """
        --range A-B  Frames to draw, by the run's frame numbers; A- and -B are open ranges; A is one frame.
            [all]
        --no-detections  Leave out the detections.
        --no-ellipses  Leave out the error ellipses.
        --no-pose  Leave out the skeleton.
        --before  Draw the start of the refinement as well.
        --no-legend  Leave out legend, camera name and frame number; the image keeps its size.
        --scale S  Scale of the output, such as 0.5. [1; --grid fits a screen]
        """,
        range=options.frame_range,
        scale={"kind": float, "read": options.positive},
    ),
    *rows(
        "Output",
        """
        -o, --output FOLDER  Folder for the results. [RUN/overlay]
        --fps HZ  Frame rate of the output. [that of the video, otherwise of the run]
        --png  Write a folder of PNG files instead of a video.
        --grid  Write all cameras side by side into grid.mp4.
        """,
        output=Path,
        fps={"kind": float, "read": options.positive},
    ),
    options.QUIET,
    options.AS_JSON,
)


@takes(*OPTIONS)
def overlay(
    run: Path,
    videos: Path | None = None,
    *,
    plain: bool,
    output: Path | None = None,
    range: FrameRange | None = None,
    quiet: bool,
    as_json: bool,
    **drawing: Any,
) -> None:
    """Draw a run on its videos: detections, reprojected skeleton, error ellipses.

    Of a run of several people, all are drawn, in one colour each.

    Detections are discs, from green (trusted) to crimson; rejected ones are
    crosses, with a line to the joint of the pose; a diamond marks a left–right
    swap. Ellipses are drawn at 2 standard deviations.

    [bold]Examples[/bold]

    skelsplat overlay out videos/

    skelsplat overlay out videos/ --grid --range 100-200

    skelsplat overlay out videos/ --camera cam01 --png -o frames

    skelsplat overlay out frames/ --fps 60 --scale 0.5 --no-detections

    skelsplat overlay out --plain --grid
    """
    if plain == (videos is not None):
        expected = "expected a folder of videos or images, or --plain to draw on plain frames"
        raise typer.BadParameter(f"{expected}, got {'both' if plain else 'neither'}", param_hint="VIDEOS")
    opencv()  # first: its extra has all that the command needs
    from skelsplat.run.overlay import OverlayJob, write_overlay  # OpenCV takes long to load
    from skelsplat.viz.overlay import Shown

    parts = {name: drawing.pop(name) for name in ("pose", "ellipses", "detections", "before")}
    job = OverlayJob(
        run=run,
        videos=videos,
        out=output or run / "overlay",
        shown=Shown(rejected_below=sk.REJECTED_WEIGHT, **parts),
        frames=range or FrameRange(),
        **drawing,
    )
    with collected_warnings(telling(quiet=quiet)) as found, progress("frames", shown=not quiet) as count:
        written = write_overlay(job, count)
    if as_json:
        files, findings = ([one.to_dict() for one in several] for several in (written, found))
        print_json(
            {
                "run": str(run),
                "videos": None if videos is None else str(videos),
                "files": files,
                "findings": findings,
            }
        )
    elif not quiet:
        for one in written:
            say(f"{one.path}: {one.frames} frame{'s' * (one.frames != 1)} of {one.size[0]}×{one.size[1]}")
