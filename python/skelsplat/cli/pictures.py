"""``skelsplat plot`` and ``overlay``: figures of a run in print size, and a run drawn on its videos."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import typer
from rich.console import Console

import skelsplat as sk
from skelsplat._optional import opencv
from skelsplat.cli import options
from skelsplat.cli.command import Answer, answers
from skelsplat.cli.output import print_message, progress, say, tell
from skelsplat.cli.rows import NAME_OR_PATH, positive, rows
from skelsplat.findings import collected_warnings
from skelsplat.run.angles import FILES as ANGLE_FILES
from skelsplat.run.frame_range import FrameRange
from skelsplat.run.plots import PICTURES, USUAL, read_source, write_plots

_PLOT_EPILOG = (
    f"{'. '.join(f'{name}: {words}' for name, words in PICTURES.items())}. Figures are 180 mm wide. "
    "What can be drawn of a pose file depends on what its format stores."
)

_PLOT_OPTIONS = rows(
    f"""
    RUN  Output folder of refine or demo, or a pose file.
    Drawing:
    --only FIGURES  Figures to draw: some of {", ".join(PICTURES)}.
        [trajectories,bones,errors; angles too of a run with --angles]
    --joints A,B,…  Joints of trajectories and angles, or all. [wrists and ankles, or first four; all angles]
    --range A-B  Frames to draw, by the run's frame numbers; A- and -B are open ranges; A is one frame. [all]
    --layout NAME  Joint layout, for limbs and sides: a name, or a layout file (.toml).
        [that of the run, or found from the joints' names]
    Output:
    -o, --output FOLDER  Folder for the figures. [RUN/plots; of a file, plots/FILE next to it]
    --format FORMATS  png, pdf or png,pdf. [= png]
    """,
    only=partial(options.some_of, tuple(PICTURES)),
    range=options.frame_range,
    layout={"marks": (NAME_OR_PATH,)},
    format=partial(options.some_of, ("png", "pdf")),
)


@answers(*_PLOT_OPTIONS, epilog=_PLOT_EPILOG)
def plot(
    run: Path,
    *,
    format: tuple[str, ...],
    only: tuple[str, ...] | None = None,
    joints: str | None = None,
    range: FrameRange | None = None,
    layout: str | None = None,
    output: Path | None = None,
) -> Answer:
    """Draw joint trajectories with error bands, bone lengths and errors.

    [bold]Examples[/bold]

    skelsplat plot out --format png,pdf

    skelsplat plot out --only trajectories --joints left_wrist,right_wrist

    skelsplat plot walk.trc --only bones --layout body25b
    """
    usual = tuple(PICTURES) if (run / ANGLE_FILES[1]).is_file() else USUAL
    source = read_source(run, layout=layout, range=range or FrameRange(), joints=joints)
    folder = output or (run.parent / "plots" / run.name if run.is_file() else run / "plots")
    with progress("figures") as count:
        drawn = write_plots(source, folder, only=only or usual, formats=format, progress=count)
    for picture in (one for one in drawn if not one.files):
        print_message(f"warning: {picture.name} left out: {picture.sentence}")
    files = [path for picture in drawn for path in picture.files]

    def show(console: Console) -> None:
        for picture in (one for one in drawn if one.files):
            console.print(f"{picture.name}: {picture.sentence}")
        console.print(f"Wrote to {folder}/: {', '.join(path.name for path in files)}")

    frames = source.poses.frames
    document = {
        "input": str(source.path),
        "frames": len(frames),
        "first_frame": int(frames[0]),
        "last_frame": int(frames[-1]),
        "frame_rate_hz": source.poses.frame_rate,
        "processing": list(source.poses.processing),
        "files": [str(path) for path in files],
        **{picture.name: picture.numbers for picture in drawn},
        "left_out": {picture.name: picture.sentence for picture in drawn if not picture.files},
    }
    return Answer(document, show)


_OVERLAY_EPILOG = "Videos are MP4 (H.264). Needs pip install 'skelsplat\\[video]'."
OVERLAY_OPTIONS = rows(
    """
    RUN  Output folder of refine or demo.
    VIDEOS  Folder with one video or one folder of images per camera, named like the camera; or one of
        them. Without any: --plain. [optional]
    Input:
    --plain  Draw on plain frames of the cameras' size, without videos.
    --camera NAME  Camera to draw. Repeatable. [all]
    --order A,B,…  Video or folder of each camera, in the calibration's order, or sorted. [by name]
    --first-frame N  Number of a video's first frame in the files of the detections. Images are numbered
        by the last integer in their names. [0]
    Drawing:
    --range A-B  Frames to draw, by the run's frame numbers; A- and -B are open ranges; A is one frame. [all]
    --no-detections  Leave out the detections.
    --no-ellipses  Leave out the error ellipses.
    --no-pose  Leave out the skeleton.
    --before  Draw the start of the refinement as well.
    --no-legend  Leave out legend, camera name and frame number; the image keeps its size.
    --scale S  Scale of the output, such as 0.5. [1; --grid fits a screen]
    Output:
    -o, --output FOLDER  Folder for the results. [RUN/overlay]
    --fps HZ  Frame rate of the output. [that of the video, otherwise of the run]
    --png  Write a folder of PNG files instead of a video.
    --grid  Write all cameras side by side into grid.mp4.
    """,
    camera={"name": "cameras", "many": True, "read": options.distinct},
    order=options.order,
    first_frame={"kind": int, "limits": {}},
    range=options.frame_range,
    scale={"kind": float, "read": positive},
)


@answers(*OVERLAY_OPTIONS, epilog=_OVERLAY_EPILOG)
def overlay(
    run: Path,
    videos: Path | None = None,
    *,
    plain: bool,
    output: Path | None = None,
    range: FrameRange | None = None,
    **drawing: Any,
) -> Answer:
    """Draw a run on its videos: detections, reprojected skeleton, error ellipses.

    Of several people, each has a colour. Detections are discs, from green
    (trusted) to crimson; rejected ones are crosses, with a line to the joint of
    the pose; a diamond marks a left–right swap. Ellipses are at 2 standard deviations.

    [bold]Examples[/bold]

    skelsplat overlay out videos/ --grid --range 100-200

    skelsplat overlay out videos/ --camera cam01 --png -o frames

    skelsplat overlay out --plain
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
    with collected_warnings(tell) as found, progress("frames") as count:
        written = write_overlay(job, count)
    lines = [
        f"{one.path}: {one.frames} frame{'s' * (one.frames != 1)} of {one.size[0]}×{one.size[1]}"
        for one in written
    ]
    document = {
        "run": str(run),
        "videos": None if videos is None else str(videos),
        "files": [one.to_dict() for one in written],
        "findings": [one.to_dict() for one in found],
    }
    return Answer(document, lambda _: say(*lines))
