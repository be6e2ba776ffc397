"""``skelsplat overlay``: a run drawn on its videos."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import skelsplat as sk
from skelsplat._opencv import opencv
from skelsplat.cli import options
from skelsplat.cli.options import positive
from skelsplat.cli.output import counting, print_json, say
from skelsplat.cli.table import telling
from skelsplat.findings import collected_warnings

EPILOG = (
    "Videos are MP4 with MPEG-4 part 2 (mp4v), which VLC and most players play but browsers do not; ffmpeg "
    "-i cam01.mp4 -c:v libx264 web.mp4 converts them. Needs pip install 'skelsplat\\[video]'."
)
_INPUT, _DRAWING, _OUTPUT = "Input", "Drawing", "Output"

_Run = Annotated[Path, typer.Argument(readable=False, metavar="RUN", help="Output folder of refine or demo.")]
_Videos = Annotated[
    Path | None,
    typer.Argument(
        readable=False,
        metavar="VIDEOS",
        help="Folder with one video or one folder of images per camera, named like the camera; or one of "
        "them. Without any: --plain.",
    ),
]
_Plain = Annotated[
    bool, options.flag(_INPUT, "--plain", help="Draw on plain frames of the cameras' size, without videos.")
]
_Out = Annotated[
    Path | None,
    options.option(
        _OUTPUT, "-o", "--output", metavar="FOLDER", help="Folder for the results.", default="RUN/overlay"
    ),
]
_Camera = Annotated[
    list[str] | None,
    options.option(_INPUT, metavar="NAME", help="Camera to draw. Repeatable.", default="all"),
]
_Order = Annotated[
    str | None,
    options.option(
        _INPUT,
        metavar="A,B,…",
        help="Video or folder of each camera, in the calibration's order, or sorted.",
        default="by name",
    ),
]
_FirstFrame = Annotated[
    int | None,
    options.option(
        _INPUT,
        metavar="N",
        help="Number of a video's first frame in the files of the detections. Images are numbered by the "
        "last integer in their names.",
        default="0",
    ),
]


_NoDetections = Annotated[bool, options.flag(_DRAWING, "--no-detections", help="Leave out the detections.")]
_NoEllipses = Annotated[bool, options.flag(_DRAWING, "--no-ellipses", help="Leave out the error ellipses.")]
_NoPose = Annotated[bool, options.flag(_DRAWING, "--no-pose", help="Leave out the skeleton.")]
_Before = Annotated[
    bool, options.flag(_DRAWING, "--before", help="Draw the start of the refinement as well.")
]
_NoLegend = Annotated[
    bool,
    options.flag(
        _DRAWING,
        "--no-legend",
        help="Leave out legend, camera name and frame number; the image keeps its size.",
    ),
]
_Crop = Annotated[bool, options.flag(_DRAWING, "--crop", help="Crop to the person.")]
_Scale = Annotated[
    float | None,
    options.option(
        _DRAWING, metavar="S", help="Scale of the output, such as 0.5.", default="1; --grid fits a screen"
    ),
]
_Fps = Annotated[
    float | None,
    options.option(
        _OUTPUT,
        metavar="HZ",
        help="Frame rate of the output.",
        default="that of the video, otherwise of the run",
    ),
]
_Png = Annotated[bool, options.flag(_OUTPUT, "--png", help="Write a folder of PNG files instead of a video.")]
_Grid = Annotated[bool, options.flag(_OUTPUT, "--grid", help="Write all cameras side by side into grid.mp4.")]


# long: a parameter per option
def overlay(
    run: _Run,
    videos: _Videos = None,
    *,
    plain: _Plain = False,
    camera: _Camera = None,
    order: _Order = None,
    first_frame: _FirstFrame = None,
    range: options.Range = None,
    no_detections: _NoDetections = False,
    no_ellipses: _NoEllipses = False,
    no_pose: _NoPose = False,
    before: _Before = False,
    no_legend: _NoLegend = False,
    crop: _Crop = False,
    scale: _Scale = None,
    output: _Out = None,
    fps: _Fps = None,
    png: _Png = False,
    grid: _Grid = False,
    quiet: options.Quiet = False,
    as_json: options.AsJson = False,
) -> None:
    """Draw a run on its videos: detections, reprojected skeleton, error ellipses.

    Of a run of several people, all are drawn, in one colour each.

    Detections are discs, from green (trusted) to crimson; rejected ones are
    crosses, with a line to the joint of the pose; a diamond marks a left–right
    swap. Ellipses are drawn at 2 standard deviations.

    [bold]Examples[/bold]

    skelsplat overlay out videos/

    skelsplat overlay out videos/ --grid --range 100-200

    skelsplat overlay out videos/ --camera cam01 --crop --png -o frames

    skelsplat overlay out frames/ --fps 60 --scale 0.5 --no-detections

    skelsplat overlay out --plain --grid
    """
    if plain == (videos is not None):
        expected = "expected a folder of videos or images, or --plain to draw on plain frames"
        raise typer.BadParameter(f"{expected}, got {'both' if plain else 'neither'}", param_hint="VIDEOS")
    opencv()  # first: its extra has all that the command needs
    from skelsplat.run.frame_range import FrameRange
    from skelsplat.run.overlay import OverlayJob, write_overlay  # OpenCV takes long to load
    from skelsplat.viz.overlay import Shown

    job = OverlayJob(
        run=run,
        videos=videos,
        out=run / "overlay" if output is None else output,
        shown=Shown(
            rejected_below=sk.REJECTED_WEIGHT,
            pose=not no_pose,
            ellipses=not no_ellipses,
            detections=not no_detections,
            before=before,
        ),
        cameras=tuple(dict.fromkeys(camera or ())),
        order=order if order in (None, "sorted") else tuple(part.strip() for part in order.split(",")),
        first_frame=first_frame,
        frames=FrameRange.parse(range),
        fps=positive("--fps", fps),
        scale=positive("--scale", scale),
        legend=not no_legend,
        crop=crop,
        png=png,
        grid=grid,
    )
    with collected_warnings(telling(quiet=quiet)) as found, counting("frames", shown=not quiet) as progress:
        written = write_overlay(job, progress)
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
