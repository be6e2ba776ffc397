"""The application object, and the exit status and one-line message of every way to fail."""

from __future__ import annotations

import re
import sys
from typing import Annotated, Any, NoReturn

import typer

import skelsplat as sk
from skelsplat.cli.command import Group, LazyGroup
from skelsplat.cli.output import print_message

FAILED, BAD_USAGE, INTERRUPTED = 1, 2, 130
# The first line of each command's help.
COMMANDS = {
    "demo": "Refine the recording that ships with the package: 4 cameras, 100 frames, OpenPose.",
    "refine": "Refine the 3D pose of one person, or of several, from 2D detections.",
    "batch": "Refine many recordings, listed in a file or in the folders of a Pose2Sim project.",
    "detect": "Detect people in the videos of all cameras, for refine.",
    "calibrate": "Find where the cameras are from the detections of people who walk about.",
    "overlay": "Draw a run on its videos: detections, reprojected skeleton, error ellipses.",
    "live": "Refine frame by frame: detections as JSON lines on stdin, poses on stdout.",
    "plot": "Draw joint trajectories with error bands, bone lengths and errors.",
    "convert": "Convert a calibration, or poses (a file, or the folder of a run), to another format.",
    "check-cameras": "Find faults in a calibration: wrong unit, swapped, rotated or unsynchronised cameras.",
    "adjust-cameras": "Adjust the cameras that were turned or moved since the calibration, from recordings.",
    "app": "Open a page in the browser that does all of this, for people without a terminal.",
    "layouts": "List the joint layouts, or explain one: joints, limbs, symmetric pairs, bones.",
    "synth": "Write a simulated data set: known poses, simulated detections of two detectors.",
    "datasets": "Data sets with ground truth: list them, check one on disk.",
    "evaluate": "Run methods on a data set with ground truth and print their errors with published ones.",
    "ablate": "Repeat an ablation of the paper and print its tables with the paper's rows.",
}

# Where a command is, if not in the module of its name; `skelsplat.app` is above this package.
MODULES = {
    "app": ".app.command",
    "demo": "refine",
    "check-cameras": "cameras",
    "adjust-cameras": "cameras",
    "overlay": "pictures",
    "plot": "pictures",
    "synth": "datasets",
    "ablate": "evaluate",
}


class OneLineErrors(Group):
    """A command group that ends with ``error: …`` on stderr instead of a box or a traceback.

    Only errors that a user can act on are caught: wrong usage, `skelsplat.SkelSplatError` and `OSError`.
    Anything else is a defect of the program and keeps its traceback. If the reader of stdout is gone, the
    status is 1 without a message; every command writes its files before it prints.
    """

    _left = ""  # what a command that was interrupted says of its files

    def invoke(self, ctx: typer.Context) -> Any:  # type: ignore[override, unused-ignore]
        """Run the command; flush stdout, so that a closed pipe is an error here and not at exit."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as stop:
            self._left = str(stop)
            raise
        finally:
            if sys.stdout is not None:  # it was closed before the program began
                sys.stdout.flush()

    def main(self, args: Any = None, prog_name: str | None = None, **extra: Any) -> Any:  # type: ignore[override]
        """Run a command; with ``standalone_mode`` leave the process with its exit status."""
        if not extra.pop("standalone_mode", True):
            return super().main(args, prog_name, standalone_mode=False, **extra)
        try:
            status = super().main(args, prog_name, standalone_mode=False, **extra)
        except (KeyboardInterrupt, typer.Abort):
            status = INTERRUPTED
        except (sk.SkelSplatError, OSError) as error:
            _fail(FAILED, f"error: {_describe(error)}")
        except Exception as error:
            if not hasattr(error, "format_message"):  # what every error of usage has, in typer and in click
                raise
            _fail(BAD_USAGE, f"error: {_usage(error)}")
        if status == INTERRUPTED:
            _fail(INTERRUPTED, f"interrupted; {self._left or 'files already written are complete'}")
        sys.exit(status if isinstance(status, int) else 0)


def _fail(status: int, message: str) -> NoReturn:
    print_message(" ".join(message.split()))
    sys.exit(status)


def _describe(error: Exception) -> str:
    """Return one line that names the file, for the errors of the package and of the operating system."""
    if isinstance(error, OSError) and not isinstance(error, sk.SkelSplatError) and error.filename is not None:
        return f"{error.filename}: {(error.strerror or 'cannot be used').lower()}"
    return str(error)


def _usage(error: Any) -> str:
    """Return the message of an error of usage, beginning with the option's name, and which --help to read."""
    context = getattr(error, "ctx", None)
    command = context.command_path if context is not None else "skelsplat"
    # older versions of click add the variable of the environment, even if there is none
    start = r"^Invalid value for '?([^\s':]+)'?(?: \(env var: '\w*'\))?: "
    message = re.sub(start, r"\1: ", error.format_message()).replace("Input should be", "expected")
    if command.endswith(" refine") and message == "Missing argument 'DETECTIONS'.":
        message = f"{message.rstrip('.')}; without a CALIBRATION, skelsplat calibrate makes one"
    values = getattr(error.__cause__, "errors", None)  # of pydantic, with which newer typer reads values
    if values is not None:
        message = f"{message.partition(', unable')[0]}, got {values()[0]['input']}"
    return f"{message.rstrip('.')} (see {command} --help)"


def _show_version(value: bool) -> None:
    if value:
        typer.echo(f"skelsplat {sk.__version__}")
        raise typer.Exit


class _Program(OneLineErrors, LazyGroup):
    texts, modules = COMMANDS, MODULES


app = typer.Typer(
    name="skelsplat",
    cls=_Program,
    help="Multi-view 3D human pose from 2D keypoints, by differentiable Gaussian splatting.",
    epilog="Every command has --help with examples, and reads options from a file with --config FILE.toml. "
    "Exit status: 0 ok, 1 failed, 2 bad usage, 130 interrupted.",
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    add_completion=False,
    invoke_without_command=True,
    context_settings={"help_option_names": ["-h", "--help"]},
)


@app.callback()
def _root(
    context: typer.Context,
    version: Annotated[
        bool,
        typer.Option(
            "--version", metavar="", callback=_show_version, is_eager=True, help="Show the version and exit."
        ),
    ] = False,
) -> None:
    del version  # its callback has done the work
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())
