"""Pictures of the recordings that ship with the package: ``python docs/figures/sample.py [FOLDER]``.

They are those of ``skelsplat demo`` and ``skelsplat plot``, with fewer colours; ``pose.png`` is the upper
left of the overview, and ``several-people.png`` the overview of ``demo --people``.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

NAME = "skelsplat-demo"  # the folder of the run, which a picture names
PEOPLE = "several-people"
COLOURS = 256
# The two views of the body in parts of the overview: left, top, right, bottom.
POSE = (0.0, 0.045, 0.65, 0.6)


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
        (
            "pose",
            overview.crop([round(part * size) for part, size in zip(POSE, 2 * overview.size, strict=True)]),
        ),
    ):
        picture.quantize(COLOURS).save(folder / f"{name}.png", optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
