"""``skelsplat synth``: a simulated data set on disk."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from skelsplat import synthetic
from skelsplat.cli import options
from skelsplat.cli.output import print_json
from skelsplat.datasets.synthetic import write_simulated

Name = Annotated[str, typer.Argument(metavar="NAME", help=", ".join(synthetic.set_names) + ".")]
Root = Annotated[Path, typer.Argument(metavar="FOLDER", help="Folder to create; must not exist or be empty.")]
Poses = Annotated[
    int | None,
    typer.Option(min=1, metavar="N", help="Poses over all takes.", show_default="that of the data set"),
]
Seed = Annotated[int, typer.Option(min=0, metavar="S", help="Same seed, same files.")]
OpenPose = Annotated[
    bool, typer.Option("--openpose", metavar="", help="Also write OpenPose JSON: many small files.")
]
Force = Annotated[bool, typer.Option("--force", metavar="", help="Replace an existing simulated data set.")]


def synth(
    name: Name,
    root: Root,
    poses: Poses = None,
    seed: Seed = 0,
    openpose: OpenPose = False,
    force: Force = False,
    quiet: options.Quiet = False,
    as_json: options.AsJson = False,
) -> None:
    """Write a simulated data set: known poses, simulated detections of two detectors.

    Rig, joints, actions and number of poses are like those of the data set
    in the name. Results on it are results on simulated detections, and must be
    reported as such.

    [bold]Examples[/bold]

    skelsplat synth human36m-like data/h36m-like

    skelsplat synth dome data/dome --poses 100 --openpose
    """
    options.one_of("NAME", name, synthetic.set_names)
    data = synthetic.simulate_set(name, poses=poses, seed=seed)
    write_simulated(root, data, openpose=openpose, force=force)
    if as_json:
        takes = len(data.recordings)
        print_json({"folder": str(root), "name": name, "takes": takes, "parameters": data.parameters})
    elif not quiet:
        typer.echo(
            f"{root}: {name} (simulated), {data.parameters['poses']} poses in {len(data.recordings)} takes, "
            f"detectors {' and '.join(data.parameters['detectors'])}, seed {seed}"
        )
