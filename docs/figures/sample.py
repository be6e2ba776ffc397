"""Pictures of the recordings that ship with the package: ``python docs/figures/sample.py [FOLDER]``.

They are those of ``skelsplat demo`` and ``skelsplat plot``, with fewer colours; ``pose.png`` is the upper
left of the overview, and ``several-people.png`` the overview of ``demo --people``.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from itertools import pairwise
from pathlib import Path

import numpy as np
from PIL import Image

NAME = "skelsplat-demo"  # the folder of the run, which a picture names
PEOPLE = "several-people"
COLOURS = 256
# The two views of the body: right and bottom in parts of the overview, and white around them, px.
POSE = (0.67, 0.575)
INK = 200  # darker is drawn
MARGIN_PX = 12


def body_of(overview: Image.Image) -> Image.Image:
    """Return the two views of the body, without the overview's title."""
    width, height = overview.size
    views = overview.crop((0, 0, round(POSE[0] * width), round(POSE[1] * height)))
    ink = np.asarray(views.convert("L")) < INK
    rows = np.flatnonzero(ink.any(axis=1))
    top = next(int(row) for last, row in pairwise(rows) if row - last > MARGIN_PX)  # below the title
    columns = np.flatnonzero(ink[top:].any(axis=0))
    return views.crop((0, top - MARGIN_PX, columns[-1] + MARGIN_PX, rows[-1] + MARGIN_PX))


def main(folder: Path) -> None:
    with tempfile.TemporaryDirectory() as made:
        for command in (
            ["demo", "-o", NAME],
            ["plot", NAME, "--only", "trajectories,angles"],
            ["demo", "--people", "-o", PEOPLE],
        ):
            subprocess.run([sys.executable, "-m", "skelsplat", *command, "--quiet"], check=True, cwd=made)
        pictures = (
            f"{NAME}/{name}.png" for name in ("overview", "weights", "plots/trajectories", "plots/angles")
        )
        overview, weights, paths, angles, people = (
            Image.open(Path(made) / picture).convert("RGB")
            for picture in (*pictures, f"{PEOPLE}/overview.png")
        )
    for name, picture in (
        ("overview", overview),
        ("weights", weights),
        ("trajectories", paths),
        ("angles", angles),
        ("several-people", people),
        ("pose", body_of(overview)),
    ):
        picture.quantize(COLOURS).save(folder / f"{name}.png", optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
