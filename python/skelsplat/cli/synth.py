"""``skelsplat synth``: a simulated data set on disk."""

from __future__ import annotations

from pathlib import Path

import typer

from skelsplat import synthetic
from skelsplat.cli import options
from skelsplat.cli.command import takes
from skelsplat.cli.output import print_json, say
from skelsplat.cli.rows import rows
from skelsplat.datasets.synthetic import write_simulated
from skelsplat.synthetic.people_sets import PEOPLE_SET
from skelsplat.synthetic.sets import RecordingSet

NAMES = (*synthetic.set_names, PEOPLE_SET)
_DEFAULTS = {"people": 3, "views": 4, "scenes": 5, "frames": 300}

OPTIONS = (
    *rows(
        "",
        f"""
        NAME  {", ".join(NAMES)}.
        FOLDER  Folder to create; must not exist or be empty.
        --poses N  Poses over all takes. [that of the data set]
        --seed S  Same seed, same files. [= 0]
        --openpose  Also write OpenPose JSON: many small files.
        --force  Replace an existing simulated data set.
        """,
        name=lambda _option, name: options.one_of("NAME", name, NAMES),
        folder=Path,
        poses={"kind": int, "limits": {"min": 1}},
        seed={"kind": int, "default": 0, "limits": {"min": 0}},
    ),
    *rows(
        f"Options of {PEOPLE_SET}",
        "".join(
            f"--{name} {metavar}  {words} [{_DEFAULTS[name]}]\n"
            for name, metavar, words in (
                ("people", "Q", "People, 2 to 6."),
                ("views", "M", "Cameras, 3 to 8."),
                ("scenes", "K", "Number of scenes."),
                ("frames", "F", "Frames of each scene, at 30 Hz."),
            )
        ),
        **dict.fromkeys(_DEFAULTS, int),
    ),
    options.QUIET,
    options.AS_JSON,
)


@takes(*OPTIONS)
def synth(
    *,
    name: str,
    folder: Path,
    seed: int,
    poses: int | None = None,
    openpose: bool,
    force: bool,
    quiet: bool,
    as_json: bool,
    **of_people: int,
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
    if name == PEOPLE_SET and poses is not None:
        message = f"does not apply to {PEOPLE_SET}; the length of its scenes is given with --frames"
        raise typer.BadParameter(message, param_hint="--poses")
    for key in of_people if name != PEOPLE_SET else ():
        raise typer.BadParameter(f"does not apply to {name}, only to {PEOPLE_SET}", param_hint=f"--{key}")
    if name == PEOPLE_SET:
        data: RecordingSet = synthetic.simulate_people_set(**{**_DEFAULTS, **of_people}, seed=seed)
        number = data.parameters["scenes"]
        length = f"{number} scene{'s' * (number != 1)} of {data.parameters['frames']} frames"
        what = f"{data.parameters['people']} people, {data.parameters['views']} views, {length}"
    else:
        data = synthetic.simulate_set(name, poses=poses, seed=seed)
        what = f"{data.parameters['poses']} poses in {len(data.recordings)} takes"
    write_simulated(folder, data, openpose=openpose, force=force)
    if as_json:
        about = {"name": name, "takes": len(data.recordings), "parameters": data.parameters}
        print_json({"folder": str(folder), **about})
    elif not quiet:
        detectors = " and ".join(data.parameters["detectors"])
        say(f"{folder}: {name} (simulated), {what}, detectors {detectors}, seed {seed}")
