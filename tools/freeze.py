"""Freeze the results of a set of runs, and compare two such sets to show that a change does not alter them.

    python tools/freeze.py make A --python OLD/bin/python       # the runs of one version, 4 minutes
    python tools/freeze.py make B --python NEW/bin/python --inputs A
    python tools/freeze.py compare A B                          # status 1 if they differ

`--only NAME` (repeatable) makes or compares a part; `list` prints the names. Arrays are compared bit for bit,
tables and marker files byte for byte, JSON number by number. What depends on the clock or the machine (times,
threads, versions, paths) is left out, as are words, pictures and pages. JSON keys may be renamed or added; a
missing number is a difference. Result folders may be renamed. Lists of settings are not compared, only their
results.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

ABLATIONS = (
    *("encoding", "accumulation", "views", "initialisation", "noise"),
    *("symmetry", "resolution", "covariance", "coverage"),
)
VOLATILE = re.compile(
    r"^run$|seconds|timing|settings|_s$|_ms$|ms/pose|per_(pose|frame|second)|threads|version|created|command"
    r"|folder|path|time$|sha|digest|files$",
    re.I,
)
NUMBER = re.compile(r"[-+]?[\d.]+(e[-+]?\d+)?|nan|-?inf", re.IGNORECASE)
PAGES = {".png", ".html", ".log", ".md", ".toml", ".state"}

# What {demo}, {people} and {dlc} stand for: a calibration, detections, and what they do not say.
GIVEN = {
    "demo": "{inputs}/demo/calibration.toml {inputs}/demo/detections --layout body25b",
    "people": "{inputs}/people/calibration.toml {inputs}/people/detections --layout body25b --unit m",
    "dlc": "{inputs}/dlc/calibration.toml {inputs}/dlc/detections --layout coco17 --unit cm",
}
ALL_FORMATS = "--write csv,trc,c3d,json,nc"

# One version's runs: name → (arguments of `python -m skelsplat`, …); {inputs} and {out} are folders,
# {as_given} keeps a demo that can adjust its cameras from doing so.
RUNS: dict[str, list[str]] = {
    "demo": ["demo{as_given} --frame-by-frame -o {out}/run"],
    "demo-in-time": ["demo{as_given} -o {out}/run"],
    "demo-paper": ["demo{as_given} --paper -o {out}/run"],
    "own-openpose": [
        f"refine {{demo}} --unit m -o {{out}}/run --fps 60 --frame-by-frame --fill-gaps 10 --fill-weak "
        f"--filter butterworth:6 {ALL_FORMATS} --without cam_02 --no-html",
        "convert {out}/run {out}/poses.c3d --fps 60 --y-up",
        "check-cameras {demo} --unit m --json",
    ],
    "own-deeplabcut": [
        "refine {dlc} -o {out}/run --min-confidence 0.2 --sigma-mm 40 --symmetry-tier 3 --fps 30 "
        "--frame-by-frame --y-up --no-html",
        "refine {dlc} -o {out}/paper --paper --max-steps 40 --no-html",
        "check-cameras {dlc} --json",
    ],
    "people": [
        "demo --people -o {out}/run",
        f"refine {{people}} -o {{out}}/two --fps 60 --people 2 --angles {ALL_FORMATS} --y-up",
        "refine {people} -o {out}/one --fps 60 --person 1 --fill-gaps 20 --no-html",
        "refine {people} -o {out}/largest --person largest --frame-by-frame --no-html",
    ],
    "recording": [
        "refine {demo} --unit m -o {out}/run --fps 60 --angles --fill-gaps 10 --filter one-euro "
        "--offset cam_02=1 --no-html",
        "refine {dlc} -o {out}/dlc --fps 30 --write csv,c3d,json,nc --angles --no-html",
        "convert {out}/run {out}/converted.json --fps 60",
        "convert {inputs}/demo/calibration.toml {out}/cameras.json --unit m",
    ],
    "cameras": [
        "adjust-cameras {demo} --unit m -o {out}/fixed.json --clock --focal --json",
        "adjust-cameras {people} -o {out}/by-all.json --json",
        "refine {demo} --unit m -o {out}/run --fps 60 --adjust-cameras --no-html",
        "check-cameras {demo} --unit m --offset cam_02=5 --json",
        "check-cameras {demo} --unit mm --json",
        "check-cameras {people} --json",
    ],
    "batch": ["batch {inputs}/sessions.toml -o {out}/batch --jobs 1 --json"],
    "long": ["refine {inputs}/long.json {inputs}/long.npz -o {out}/run --layout coco17 --fps 50 --no-html"],
    "live": [
        f"live {{inputs}}/live.json --layout coco17{options} < {{inputs}}/live.jsonl"
        for options in ("", " --fps 30", " --fps 30 --lag 3", " --fps 30 --people all")
    ],
    "evaluate-people": [
        "synth people {out}/data --people 3 --views 4 --scenes 2 --frames 60 --quiet",
        "evaluate synthetic {out}/data -o {out}/results --json",
    ],
    "evaluate": [
        "synth human36m-like {out}/data --poses 60 --seed 3 --quiet",
        "evaluate synthetic {out}/data -o {out}/results --methods all --json",
        "synth occlusion-person-like {out}/occlusion --poses 12 --quiet",
        "evaluate synthetic {out}/occlusion -o {out}/results-occlusion --json --per-joint",
    ],
    **{f"ablate-{name}": [f"ablate {name} --poses 20 --json -o {{out}}/results"] for name in ABLATIONS},
}


def make(out: Path, python: str, inputs: Path, only: list[str]) -> int:
    """Run every command of every set with one version, and keep its exit status; 1 if `arrays` failed."""
    if not inputs.exists():
        write_inputs(inputs)
    failed = 0
    skelsplat = [python, "-m", "skelsplat"]
    shown = subprocess.run([*skelsplat, "demo", "--help"], capture_output=True, text=True, check=True)
    as_given = " --no-adjust" if "--no-adjust" in shown.stdout else ""
    for name in only:
        folder = out / name
        folder.mkdir(parents=True, exist_ok=True)
        if name == "arrays":
            failed += _run([python, str(Path(__file__).resolve()), "arrays", str(folder)], folder / "log.txt")
            continue
        folders = {"inputs": inputs.resolve(), "out": folder.resolve()}
        given = {key: text.format(**folders) for key, text in GIVEN.items()}
        for place, text in enumerate(RUNS[name]):
            command, _, stdin = text.format(**folders, **given, as_given=as_given).partition(" < ")
            stdout = folder / f"stdout{place}.json"
            status = _run([*skelsplat, *command.split()], stdout, stdin or os.devnull)
            (folder / f"exit{place}.json").write_text(f'{{"status": {status}}}\n')
            print(f"{name}: exit {status}: skelsplat {text}", flush=True)
    return failed


def _run(command: list[str], stdout: Path, stdin: str = os.devnull) -> int:
    log = stdout.with_suffix(".log")
    with stdout.open("wb") as out, log.open("wb") as err, Path(stdin).open("rb") as given:
        return subprocess.run(command, stdin=given, stdout=out, stderr=err, check=False).returncode


def recording(seed: int, frames: int = 60, cameras: int = 4, layout: Any = "coco17") -> tuple[Any, ...]:
    """Return the cameras, the poses and the detections of a walk in mm, with outliers and gaps."""
    import skelsplat as sk
    from skelsplat import synthetic

    rig, pose = synthetic.ring(cameras, radius_mm=4200.0), synthetic.motion("walk", frames, seed=seed)
    pose = synthetic.in_layout(pose, sk.layouts.get(layout or "h36m17"))
    noise = synthetic.DetectionNoise(outlier_rate=0.06, outlier_px=90.0, miss_rate=0.08)
    detections = synthetic.simulate_detections(pose, rig, noise=noise, layout=layout, seed=seed)
    detections[5, :, 3] = detections[9, 1:] = np.nan
    return rig, pose, detections


def arrays(folder: Path) -> None:
    """Refine simulated arrays with the package of this interpreter, and keep every array of the results."""
    import skelsplat as sk
    from skelsplat.association import choose_person

    def keep(name: str, **values: Any) -> None:
        np.savez(folder / f"{name}.npz", **values)

    for seed, cameras, layout in ((0, 4, "coco17"), (1, 3, "h36m17"), (2, 2, None), (3, 8, "coco17")):
        rig, pose, detections = recording(seed, cameras=cameras, layout=layout)
        start = pose + np.random.default_rng(seed).normal(size=pose.shape) * 30
        paper = sk.RefineConfig.paper(max_steps=60)
        runs = {
            "annealed": sk.refine(None, detections, rig, layout=layout),
            "prior": sk.refine(start, detections, rig, layout=layout, init_sigma=30.0),
            "given": sk.refine(start, detections, rig, layout=layout),
            "paper": sk.refine(start[:8], detections[:8], rig, layout=layout, config=paper),
            "recording": sk.refine_sequence(detections, rig, fps=50, layout=layout),
        }
        chunks = sk.refine_batches([detections[:40], detections[40:]], rig, fps=50, layout=layout)
        whole = np.concatenate([part.pose for part in chunks])
        keep(f"batches-{seed}", same=np.array_equal(whole, runs["recording"].pose, equal_nan=True))
        for rate in (None, 50):
            refiner = sk.Refiner(rig, layout=layout, fps=rate)
            poses = [np.asarray(refiner.step(frame).pose) for frame in detections]
            keep(f"step-{seed}-{rate}", pose=np.array(poses))
        if layout is not None:
            found = sk.adjust_cameras(detections, rig).cameras
            keep(f"adjusted-{seed}", R=[c.R for c in found], t=[c.t for c in found])
            # another person, who is the same 20 frames later
            people = np.stack([detections, np.roll(detections, 20, axis=0)], axis=2)
            for one in sk.track(people, rig, fps=50, layout=layout):
                kept = {"frames": one.frames, "slots": one.slots, "pose": one.refinement.pose}
                keep(f"person-{seed}-{one.id}", **kept)
            tracker = sk.Tracker(rig, layout=layout, fps=50)
            live = [(p.id, np.asarray(p.refinement.pose)) for frame in people for p in tracker.step(frame)]
            keep(f"tracker-{seed}", ids=[k for k, _ in live], poses=[x for _, x in live])
            person, places = choose_person(people, rig, layout=sk.layouts.get(layout))
            keep(f"chosen-{seed}", person=person, places=places)
        for name, result in runs.items():
            names = (key for key in dir(result) if not key.startswith("_") and not VOLATILE.search(key))
            values = {key: getattr(result, key) for key in names}
            fields = {key: np.asarray(value) for key, value in values.items() if not callable(value)}
            keep(f"{name}-{seed}", **{k: v for k, v in fields.items() if v.dtype != object})
        for method in ("dlt", "robust"):
            keep(f"{method}-{seed}", pose=np.asarray(sk.triangulate(detections, rig, method=method)))


def write_inputs(folder: Path) -> None:
    """Write the files of the own-file runs: the embedded recordings, and simulated ones."""
    import skelsplat as sk
    from skelsplat.cameras import altered
    from skelsplat.io import sample, write_calibration

    sessions = '[defaults]\nunit = "m"\nlayout = "body25b"\nfps = 60\n'
    for name in ("demo", "people"):
        paths = sample.extract(folder / name, people=name == "people")
        paths.calibration.rename(folder / name / "calibration.toml")
        paths.detections.rename(folder / name / "detections")
        given = f'calibration = "{name}/calibration.toml"\ndetections = "{name}/detections"'
        sessions += f'[[session]]\nname = "{name}"\n{given}\n'
    (folder / "sessions.toml").write_text(f'{sessions}people = "all"\n')

    rig, _, detected = recording(5, frames=30_000)
    write_calibration(folder / "long.json", rig)
    np.savez(folder / "long.npz", detections=detected, camera_names=rig.names)

    rig, _, detected = recording(6, frames=80)
    write_calibration(folder / "live.json", rig)
    lines = [json.dumps({"frame": f, "detections": x.tolist()}) for f, x in enumerate(detected)]
    (folder / "live.jsonl").write_text("\n".join([*lines[:40], "{}", *lines[40:]]) + "\n")

    rig, _, detected = recording(7, frames=50, cameras=3)
    (folder / "dlc" / "detections").mkdir(parents=True)
    lens = [altered(c, t=c.t / 10, distortion=[-0.05, 0.01, 0.0, 0.0, 0.0]) for c in rig]
    write_calibration(folder / "dlc" / "calibration.toml", sk.CameraRig(lens, unit="cm"))
    joints = [joint for joint in sk.layouts.COCO17.joints for _ in range(3)]
    heads = [["scorer"] + ["D"] * 51, ["bodyparts", *joints], ["coords"] + ["x", "y", "likelihood"] * 17]
    for name, own in zip(rig.names, detected.swapaxes(0, 1), strict=True):
        rows = [
            [str(f), *("" if np.isnan(x) else f"{x:.3f}" for x in one.ravel())] for f, one in enumerate(own)
        ]
        text = "\n".join(",".join(row) for row in [*heads, *rows])
        (folder / "dlc" / "detections" / f"{name}.csv").write_text(f"{text}\n")


def compare(before: Path, after: Path, only: list[str]) -> int:
    """Print every difference between two frozen sets; 1 if there is one."""
    differences = 0
    for name in only:
        files = sorted(path for path in (before / name).rglob("*") if path.is_file())
        found = []
        for a in files:
            b = after / a.relative_to(before)
            here = [b] if b.exists() else (after / name).rglob(a.name)  # in a folder that was renamed
            each = [_differences(a, other) for other in here] or [["missing"]]
            found += [f"{b}: {text}" for text in min(each, key=len)]
        print(f"{name}: {len(files)} files, {'as before' if not found else f'{len(found)} differences'}")
        for text in found[:12]:
            print(f"  {text}")
        differences += len(found)
    return int(differences > 0)


def _differences(a: Path, b: Path) -> list[str]:
    """Return what differs between two files."""
    if a.suffix in PAGES or a.name.startswith(".") or "cache" in str(a):
        return []
    if a.suffix == ".npz":
        return _arrays_differ(a, b)
    if a.suffix == ".json" and a.stat().st_size:
        try:
            return _numbers_differ(_documents(a), _documents(b))
        except json.JSONDecodeError:
            return []  # what people read
    if a.suffix == ".csv":
        return ["a number differs"] if _table(a) != _table(b) else []
    return ["bytes differ"] if a.suffix in {".trc", ".c3d"} and a.read_bytes() != b.read_bytes() else []


def _documents(path: Path) -> Any:
    """Return the document of a file, or the list of them that its lines hold."""
    text = path.read_text()
    try:
        return json.loads(text)
    except json.JSONDecodeError:
        return [json.loads(line) for line in text.splitlines()]


def _table(path: Path) -> list[list[str]]:
    """Return the numbers of a csv file, but those of columns of times; labels are words."""
    with path.open(newline="") as stream:
        rows = list(csv.reader(stream))
    keep = [k for k, name in enumerate(rows[0]) if not VOLATILE.search(name)] if rows else []
    others = (row for row in rows if "ms" not in row)
    return [[row[k] for k in keep if k < len(row) and NUMBER.fullmatch(row[k])] for row in others]


def _arrays_differ(a: Path, b: Path) -> list[str]:
    def differ(x: np.ndarray, y: np.ndarray) -> bool:
        words = {x.dtype.kind, y.dtype.kind} & {"U", "S"}
        return not np.array_equal(x, y) if words else x.tobytes() != y.tobytes()

    with np.load(a, allow_pickle=False) as old, np.load(b, allow_pickle=False) as new:
        keys = [key for key in old.files if not VOLATILE.search(key)]
        return [f"{key} differs" for key in keys if key not in new.files or differ(old[key], new[key])]


def _numbers_differ(a: Any, b: Any) -> list[str]:
    """Return the numbers that are gone; keys may be others."""
    old, new = dict(_leaves(a)), dict(_leaves(b))
    gone = Counter(value for key, value in old.items() if new.get(key) != value)
    gone -= Counter(value for key, value in new.items() if old.get(key) != value)
    return [
        f"{key}: {value} became {new.get(key, 'nothing')}"
        for key, value in old.items()
        if value in gone and new.get(key) != value
    ]


def _leaves(value: Any, path: str = "") -> Any:
    """Yield (path, number) of a document, but of what depends on the clock or the machine."""
    if isinstance(value, dict) and value.get("unit") != "ms":  # a table of times
        for key, part in value.items():
            if not VOLATILE.search(str(key)):
                yield from _leaves(part, f"{path}.{key}")
    elif isinstance(value, list):
        for k, part in enumerate(value):
            yield from _leaves(part, f"{path}[{k}]")
    elif isinstance(value, (int, float)) and not isinstance(value, bool):
        yield path, float(value).hex()


def main() -> int:
    """Read the command line."""
    names = [*RUNS, "arrays"]
    shape = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=shape)
    parser.add_argument("command", choices=("make", "compare", "list", "arrays"))
    parser.add_argument("folders", type=Path, nargs="*")
    parser.add_argument("--only", action="append", choices=names)
    parser.add_argument("--python", default=sys.executable)
    parser.add_argument("--inputs", type=Path, help="folder of a frozen set whose input files are used")
    given = parser.parse_args()
    only = given.only or names
    if given.command == "list":
        print("\n".join(names))
    elif given.command == "arrays":
        arrays(*given.folders)
    elif given.command == "compare":
        return compare(*given.folders, only)
    else:
        (out,) = given.folders
        return make(out, given.python, (given.inputs or out) / "inputs", only)
    return 0


if __name__ == "__main__":
    sys.exit(main())
