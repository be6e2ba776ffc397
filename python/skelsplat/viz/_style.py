"""Colours, sizes and the file writer shared by the figures."""

from __future__ import annotations

import io
import os
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

DPI = 100
WIDTH_IN = 14.0  # 1400 px

# Okabe and Ito's palette: told apart under the common colour-vision deficiencies.
BEFORE = "#8c8c8c"
AFTER = "#0072b2"
LEFT = "#0072b2"
RIGHT = "#d55e00"
MIDDLE = "#222222"
DETECTION = "#009e73"
REPROJECTION = "#d55e00"
REJECTED = "#b3006b"
SWAPPED = "#e69f00"

TITLE_PT = 13
LABEL_PT = 11
SMALL_PT = 10


def new_figure(height_in: float) -> Figure:
    """Return an empty figure 1400 px wide and ``height_in`` inches (100 px each) tall, on an Agg canvas."""
    figure = Figure(figsize=(WIDTH_IN, height_in), dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def box(
    figure: Figure, left: float, bottom: float, width: float, height: float
) -> tuple[float, float, float, float]:
    """Return the place of axes in parts of ``figure``, from inches."""
    across, up = figure.get_size_inches()
    return left / across, bottom / up, width / across, height / up


def tidy(axes: Axes) -> None:
    """Take the box off an axes and set its text sizes."""
    axes.spines["top"].set_visible(False)
    axes.spines["right"].set_visible(False)
    axes.tick_params(labelsize=SMALL_PT)
    axes.xaxis.label.set_fontsize(LABEL_PT)
    axes.yaxis.label.set_fontsize(LABEL_PT)
    axes.title.set_fontsize(TITLE_PT)


def save_png(figure: Figure, path: str | os.PathLike[str]) -> Path:
    """Write ``figure`` as a PNG, whole or not at all (`write_whole`).

    Raises
    ------
    OSError
        If the folder cannot be written.
    """
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI, metadata={"Software": "skelsplat"})
    return write_whole(path, buffer.getvalue())


def write_whole(path: str | os.PathLike[str], content: bytes) -> Path:
    """Write a file whole or not at all.

    The bytes go to a temporary file beside ``path``, which then takes its name: an interrupted run leaves the
    former file.

    Raises
    ------
    OSError
        If the folder cannot be written.
    """
    target = Path(path)
    try:
        handle, temporary = tempfile.mkstemp(prefix=f".{target.name}.", dir=target.parent)
        try:
            with os.fdopen(handle, "wb") as stream:
                stream.write(content)
            Path(temporary).chmod(0o644)
            Path(temporary).replace(target)
        except BaseException:
            Path(temporary).unlink(missing_ok=True)
            raise
    except OSError as error:  # of a full disk it names no file, of others the temporary one
        raise OSError(error.errno, error.strerror, str(target)) from error
    return target
