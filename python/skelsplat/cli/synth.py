"""``skelsplat synth``: a simulated data set on disk."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from skelsplat import synthetic
from skelsplat.cli import options
from skelsplat.cli.output import print_json, say
from skelsplat.datasets.synthetic import write_simulated
from skelsplat.synthetic.people_sets import PEOPLE_SET
from skelsplat.synthetic.sets import RecordingSet

NAMES = (*synthetic.set_names, PEOPLE_SET)
_OF_PEOPLE = f"Options of {PEOPLE_SET}"
_DEFAULTS = {"people": 3, "views": 4, "scenes": 5, "frames": 300}

Name = Annotated[str, typer.Argument(metavar="NAME", help=", ".join(NAMES) + ".")]
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


def _option(name: str, metavar: str, words: str) -> Any:
    """Return an option of the set of several people."""
    default = str(_DEFAULTS[name])
    return typer.Option(metavar=metavar, help=words, show_default=default, rich_help_panel=_OF_PEOPLE)


People = Annotated[int | None, _option("people", "Q", "People, 2 to 6.")]
Views = Annotated[int | None, _option("views", "M", "Cameras, 3 to 8.")]
Scenes = Annotated[int | None, _option("scenes", "K", "Number of scenes.")]
Frames = Annotated[int | None, _option("frames", "F", "Frames of each scene, at 30 Hz.")]


def synth(
    name: Name,
    root: Root,
    poses: Poses = None,
    seed: Seed = 0,
    people: People = None,
    views: Views = None,
    scenes: Scenes = None,
    frames: Frames = None,
    openpose: OpenPose = False,
    force: Force = False,
    quiet: options.Quiet = False,
    as_json: options.AsJson = False,
) -> None:
    """Write a simulated data set: known poses, simulated detections of two detectors.

    Rig, joints, actions and number of poses are like those of the data set
    in the name; people has scenes in which several people meet. Results on it
    are results on simulated detections, and must be reported as such.

    [bold]Examples[/bold]

    skelsplat synth human36m-like data/h36m-like

    skelsplat synth dome data/dome --poses 100 --openpose

    skelsplat synth people data/people --people 4 --views 5 --scenes 10
    """
    options.one_of("NAME", name, NAMES)
    given = {"people": people, "views": views, "scenes": scenes, "frames": frames}
    made = {key: value for key, value in given.items() if value is not None}
    if name == PEOPLE_SET and poses is not None:
        message = f"does not apply to {PEOPLE_SET}; the length of its scenes is given with --frames"
        raise typer.BadParameter(message, param_hint="--poses")
    for key in made if name != PEOPLE_SET else ():
        raise typer.BadParameter(f"does not apply to {name}, only to {PEOPLE_SET}", param_hint=f"--{key}")
    if name == PEOPLE_SET:
        data: RecordingSet[Any] = synthetic.simulate_people_set(**{**_DEFAULTS, **made}, seed=seed)
        number = data.parameters["scenes"]
        length = f"{number} scene{'s' * (number != 1)} of {data.parameters['frames']} frames"
        what = f"{data.parameters['people']} people, {data.parameters['views']} views, {length}"
    else:
        data = synthetic.simulate_set(name, poses=poses, seed=seed)
        what = f"{data.parameters['poses']} poses in {len(data.recordings)} takes"
    write_simulated(root, data, openpose=openpose, force=force)
    if as_json:
        about = {"name": name, "takes": len(data.recordings), "parameters": data.parameters}
        print_json({"folder": str(root), **about})
    elif not quiet:
        detectors = " and ".join(data.parameters["detectors"])
        say(f"{root}: {name} (simulated), {what}, detectors {detectors}, seed {seed}")
