"""``skelsplat plot``: figures of a run or of a pose file, in print size."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

from skelsplat.cli import options
from skelsplat.cli.command import takes
from skelsplat.cli.findings import telling
from skelsplat.cli.output import Terminal, print_json, print_message, progress
from skelsplat.cli.rows import NAME_OR_PATH, rows
from skelsplat.findings import collected_warnings
from skelsplat.run.angles import FILES as ANGLE_FILES
from skelsplat.run.frame_range import FrameRange
from skelsplat.run.plots import PICTURES, USUAL, Drawn, Source, read_source, write_plots

EPILOG = (
    "trajectories: positions with bands of ±1 and ±2 standard deviations. bones: lengths of the limbs, left "
    "next to right. errors: median reprojection error and share of rejected detections, camera by joint. "
    "angles: joint angles with the same bands. "
    "Figures are 180 mm wide; further pages of PNG files are numbered. A pose file is npz, csv, trc, c3d, "
    "json or nc; what can be drawn depends on what its format stores."
)

OPTIONS = (
    *rows("", "RUN  Output folder of refine or demo, or a pose file.", run=Path),
    *rows(
        "Drawing",
        """
        --only FIGURES  Figures to draw: some of trajectories, bones, errors, angles.
            [trajectories,bones,errors; angles too of a run with --angles]
        --joints A,B,…  Joints for the trajectories, or all. [wrists and ankles, or the first four]
        --range A-B  Frames to draw, by the run's frame numbers; A- and -B are open ranges; A is one frame.
            [all]
        --layout NAME  Joint layout, for limbs and sides: a name, or a layout file (.toml).
            [that of the run, or found from the joints' names]
        """,
        only=partial(options.some_of, PICTURES),
        range=options.frame_range,
        layout={"marks": (NAME_OR_PATH,)},
    ),
    *rows(
        "Output",
        """
        -o, --output FOLDER  Folder for the figures. [RUN/plots; of a file, plots/FILE next to it]
        --format FORMATS  png, pdf or png,pdf. [= png]
        """,
        output=Path,
        format=partial(options.some_of, ("png", "pdf")),
    ),
    options.QUIET,
    options.AS_JSON,
)


@takes(*OPTIONS)
def plot(
    run: Path,
    *,
    format: tuple[str, ...],
    only: tuple[str, ...] | None = None,
    joints: str | None = None,
    range: FrameRange | None = None,
    layout: str | None = None,
    output: Path | None = None,
    quiet: bool,
    as_json: bool,
) -> None:
    """Draw joint trajectories with error bands, bone lengths and errors.

    [bold]Examples[/bold]

    skelsplat plot out

    skelsplat plot out -o figures --format png,pdf

    skelsplat plot out --only trajectories --joints left_wrist,right_wrist

    skelsplat plot out --only angles

    skelsplat plot out --range 200-400

    skelsplat plot walk.trc --only bones --layout body25b

    skelsplat plot out --json | jq .bones
    """
    usual = PICTURES if (run / ANGLE_FILES[1]).is_file() else USUAL
    with collected_warnings(telling(quiet=quiet)):
        source = read_source(run, layout=layout, range=range or FrameRange(), joints=joints)
    folder = output or (run.parent / "plots" / run.name if run.is_file() else run / "plots")
    with progress("figures", shown=not quiet) as count:
        drawn = write_plots(source, folder, only=only or usual, formats=format, progress=count)
    for picture in drawn:
        if not picture.files and (quiet or as_json):
            print_message(f"warning: {picture.name} left out: {picture.sentence}")
    if as_json:
        print_json(_report(source, drawn))
    elif not quiet:
        _print(folder, drawn)


def _print(folder: Path, drawn: list[Drawn]) -> None:
    console = Terminal()
    for picture in drawn:
        console.print(
            f"{picture.name}{'' if picture.files else ' left out'}: {picture.sentence}", soft_wrap=False
        )
    names = [path.name for picture in drawn for path in picture.files]
    if names:
        console.print()
        console.print(f"Wrote to {folder}/: {', '.join(names)}")


def _report(source: Source, drawn: list[Drawn]) -> dict[str, Any]:
    frames = source.poses.frames
    return {
        "input": str(source.path),
        "frames": len(frames),
        "first_frame": int(frames[0]),
        "last_frame": int(frames[-1]),
        "frame_rate_hz": source.poses.frame_rate,
        "processing": list(source.poses.processing),
        "files": [str(path) for picture in drawn for path in picture.files],
        **{picture.name: picture.numbers for picture in drawn},
        "left_out": {picture.name: picture.sentence for picture in drawn if not picture.files},
    }
