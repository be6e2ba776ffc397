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
from collections.abc import Sequence
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
PAGES = {".png", ".html", ".log", ".md", ".toml", ".state"}

# One version's runs: name → (arguments of `python -m skelsplat`, …); {inputs} and {out} are folders,
# {as_given} keeps a demo that can adjust its cameras from doing so.
RUNS: dict[str, list[str]] = {
    "demo": ["demo{as_given} --frame-by-frame -o {out}/run"],
    "demo-in-time": ["demo{as_given} -o {out}/run"],
    "demo-paper": ["demo{as_given} --paper -o {out}/run"],
    "own-openpose": [
        "refine {inputs}/demo/calibration.toml {inputs}/demo/detections -o {out}/run --unit m "
        "--layout body25b --fps 60 --frame-by-frame --fill-gaps 10 --fill-weak --filter butterworth:6 "
        "--write csv,trc,c3d,json,nc --without cam_02 --no-html",
        "convert {out}/run {out}/poses.c3d --fps 60 --y-up",
        "check-cameras {inputs}/demo/calibration.toml {inputs}/demo/detections --unit m --layout body25b "
        "--json",
    ],
    "own-deeplabcut": [
        "refine {inputs}/dlc/calibration.toml {inputs}/dlc/detections -o {out}/run --unit cm "
        "--layout coco17 --min-confidence 0.2 --sigma-mm 40 --symmetry-tier 3 --fps 30 --frame-by-frame "
        "--y-up --no-html",
        "refine {inputs}/dlc/calibration.toml {inputs}/dlc/detections -o {out}/paper --unit cm "
        "--layout coco17 --paper --max-steps 40 --no-html",
        "check-cameras {inputs}/dlc/calibration.toml {inputs}/dlc/detections --unit cm "
        "--layout coco17 --json",
    ],
    "people": [
        "demo --people -o {out}/run",
        "refine {inputs}/people/calibration.toml {inputs}/people/detections -o {out}/two --unit m "
        "--layout body25b --fps 60 --people 2 --angles --write csv,trc,c3d,json,nc --y-up",
        "refine {inputs}/people/calibration.toml {inputs}/people/detections -o {out}/one --unit m "
        "--layout body25b --fps 60 --person 1 --fill-gaps 20 --no-html",
        "refine {inputs}/people/calibration.toml {inputs}/people/detections -o {out}/largest --unit m "
        "--layout body25b --person largest --frame-by-frame --no-html",
    ],
    "recording": [
        "refine {inputs}/demo/calibration.toml {inputs}/demo/detections -o {out}/run --unit m "
        "--layout body25b --fps 60 --angles --fill-gaps 10 --filter one-euro --offset cam_02=1 --no-html",
        "refine {inputs}/dlc/calibration.toml {inputs}/dlc/detections -o {out}/dlc --unit cm "
        "--layout coco17 --fps 30 --write csv,c3d,json,nc --angles --no-html",
        "convert {out}/run {out}/converted.json --fps 60",
        "convert {inputs}/demo/calibration.toml {out}/cameras.json --unit m",
    ],
    "cameras": [
        "adjust-cameras {inputs}/demo/calibration.toml {inputs}/demo/detections -o {out}/fixed.json --unit m "
        "--layout body25b --clock --focal --json",
        "adjust-cameras {inputs}/people/calibration.toml {inputs}/people/detections -o {out}/by-all.json "
        "--unit m --layout body25b --json",
        "refine {inputs}/demo/calibration.toml {inputs}/demo/detections -o {out}/run --unit m "
        "--layout body25b --fps 60 --adjust-cameras --no-html",
        "check-cameras {inputs}/demo/calibration.toml {inputs}/demo/detections --unit m --layout body25b "
        "--offset cam_02=5 --json",
        "check-cameras {inputs}/demo/calibration.toml {inputs}/demo/detections --unit mm "
        "--layout body25b --json",
        "check-cameras {inputs}/people/calibration.toml {inputs}/people/detections --unit m "
        "--layout body25b --json",
    ],
    "batch": ["batch {inputs}/sessions.toml -o {out}/batch --jobs 1 --json"],
    "long": ["refine {inputs}/long.json {inputs}/long.npz -o {out}/run --layout coco17 --fps 50 --no-html"],
    "live": [
        "live {inputs}/live.json --layout coco17 < {inputs}/live.jsonl",
        "live {inputs}/live.json --layout coco17 --fps 30 < {inputs}/live.jsonl",
        "live {inputs}/live.json --layout coco17 --fps 30 --lag 3 < {inputs}/live.jsonl",
        "live {inputs}/live.json --layout coco17 --fps 30 --people all < {inputs}/live.jsonl",
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
    shown = subprocess.run(
        [python, "-m", "skelsplat", "demo", "--help"], capture_output=True, text=True, check=True
    )
    as_given = " --no-adjust" if "--no-adjust" in shown.stdout else ""
    for name in only:
        folder = out / name
        folder.mkdir(parents=True, exist_ok=True)
        if name == "arrays":
            failed += _run([python, str(Path(__file__).resolve()), "arrays", str(folder)], folder / "log.txt")
            continue
        for place, text in enumerate(RUNS[name]):
            folders = {"inputs": inputs.resolve(), "out": folder.resolve()}
            words = [word.format(**folders) for word in text.replace("{as_given}", as_given).split()]
            words, stdin = (words[:-2], words[-1]) if "<" in words else (words, os.devnull)
            status = _run([python, "-m", "skelsplat", *words], folder / f"stdout{place}.json", stdin)
            (folder / f"exit{place}.json").write_text(f'{{"status": {status}}}\n')
            print(f"{name}: exit {status}: skelsplat {text}", flush=True)
    return failed


def _run(command: list[str], stdout: Path, stdin: str = os.devnull) -> int:
    with (
        stdout.open("wb") as out,
        stdout.with_suffix(".log").open("wb") as err,
        Path(stdin).open("rb") as given,
    ):
        return subprocess.run(command, stdin=given, stdout=out, stderr=err, check=False).returncode


def scene(seed: int, frames: int = 60, cameras: int = 4, joints: int = 17) -> tuple[Any, ...]:
    """Return (K, R, t, pose, detections) of a simulated recording in mm, with outliers and gaps."""
    rng = np.random.default_rng(seed)
    body = rng.normal(size=(joints, 3)) * (220, 220, 450) + (0, 0, 1000)
    walk = np.cumsum(rng.normal(size=(frames, 1, 3)) * (25, 25, 2), axis=0)
    sway = np.cumsum(rng.normal(size=(frames, joints, 3)) * 6, axis=0)
    pose = body + walk + sway
    K = np.array([[1150.0, 0, 960], [0, 1150, 540], [0, 0, 1]])
    rotations, translations = [], []
    for i in range(cameras):
        angle = 2 * np.pi * i / cameras + 0.3
        centre = np.array([4200 * np.cos(angle), 4200 * np.sin(angle), 1500.0 + 150 * i])
        z = np.array([0, 0, 1000.0]) - centre
        z /= np.linalg.norm(z)
        x = np.cross(z, [0, 0, 1.0])
        x /= np.linalg.norm(x)
        R = np.stack([x, np.cross(z, x), z])
        rotations.append(R)
        translations.append(-R @ centre)
    R, t = np.array(rotations), np.array(translations)
    seen = np.einsum("mij,tnj->tmni", R, pose) + t[None, :, None]
    pixels = seen[..., :2] / seen[..., 2:] * 1150 + K[:2, 2]
    pixels += rng.normal(size=pixels.shape) * 3
    wrong = rng.random(pixels.shape[:3]) < 0.06
    pixels[wrong] += rng.normal(size=(wrong.sum(), 2)) * 90
    confidence = np.clip(rng.normal(0.8, 0.15, pixels.shape[:3]), 0.05, 1)
    detections = np.concatenate([pixels, confidence[..., None]], axis=-1)
    detections[rng.random(pixels.shape[:3]) < 0.08] = np.nan
    detections[5, :, 3] = np.nan
    detections[9, 1:] = np.nan
    return K, R, t, pose, detections


def arrays(folder: Path) -> None:
    """Refine simulated arrays with the package of this interpreter, and keep every array of the results."""
    import skelsplat as sk
    from skelsplat.association import choose_person

    from_paper = {"max_steps": 60}
    for seed, cameras, layout in ((0, 4, "coco17"), (1, 3, "h36m17"), (2, 2, None), (3, 8, "coco17")):
        K, R, t, pose, detections = scene(seed, cameras=cameras)
        rig = sk.CameraRig([sk.Camera(K, R[i], t[i], size=(1920, 1080)) for i in range(cameras)], unit="mm")
        start = pose + np.random.default_rng(seed).normal(size=pose.shape) * 30
        runs = {
            "annealed": sk.refine(None, detections, rig, layout=layout),
            "prior": sk.refine(start, detections, rig, layout=layout, init_sigma=30.0),
            "given": sk.refine(start, detections, rig, layout=layout),
            "paper": sk.refine(
                start[:8], detections[:8], rig, layout=layout, config=sk.RefineConfig.paper(**from_paper)
            ),
        }
        recording = sk.refine_sequence(detections, rig, fps=50, layout=layout)
        runs["recording"] = recording
        parts = [
            part.pose
            for part in sk.refine_batches([detections[:40], detections[40:]], rig, fps=50, layout=layout)
        ]
        same = np.array_equal(np.concatenate(parts), recording.pose, equal_nan=True)
        np.savez(folder / f"batches-{seed}.npz", same=same)
        for rate in (None, 50):
            refiner = sk.Refiner(rig, layout=layout, fps=rate)
            poses = [np.asarray(refiner.step(frame).pose) for frame in detections]
            np.savez(folder / f"step-{seed}-{rate}.npz", pose=np.array(poses))
        if layout is not None:
            adjusted = sk.adjust_cameras(detections, rig)
            np.savez(
                folder / f"adjusted-{seed}.npz",
                R=[c.R for c in adjusted.cameras],
                t=[c.t for c in adjusted.cameras],
            )
            people = people_of(detections)
            found = sk.track(people, rig, fps=50, layout=layout)
            for person in found:
                kept = {"frames": person.frames, "slots": person.slots, "pose": person.refinement.pose}
                np.savez(folder / f"person-{seed}-{person.id}.npz", **kept)
            tracker = sk.Tracker(rig, layout=layout, fps=50)
            live = [(p.id, np.asarray(p.refinement.pose)) for frame in people for p in tracker.step(frame)]
            np.savez(folder / f"tracker-{seed}.npz", ids=[k for k, _ in live], poses=[x for _, x in live])
            person, places = choose_person(people, rig, layout=sk.layouts.get(layout))
            np.savez(folder / f"chosen-{seed}.npz", person=person, places=places)
        for name, result in runs.items():
            fields = {
                key: np.asarray(getattr(result, key))
                for key in dir(result)
                if not key.startswith("_") and not callable(getattr(result, key)) and not VOLATILE.search(key)
            }
            np.savez(folder / f"{name}-{seed}.npz", **{k: v for k, v in fields.items() if v.dtype != object})
        for method in ("dlt", "robust"):
            placed = sk.triangulate(detections, rig, method=method)
            np.savez(folder / f"{method}-{seed}.npz", pose=np.asarray(placed))


def people_of(detections: Any) -> Any:
    """Return (T, M, 2, N, 3): the person of (T, M, N, 3), and another who is the same 20 frames later."""
    other = np.roll(detections, 20, axis=0)
    return np.stack([detections, other], axis=2)


def write_inputs(folder: Path) -> None:
    """Write the files of the own-file runs: the embedded recordings, and simulated ones."""
    from skelsplat.io import sample

    for name in ("demo", "people"):
        paths = sample.extract(folder / name, people=name == "people")
        paths.calibration.rename(folder / name / "calibration.toml")
        paths.detections.rename(folder / name / "detections")
    session = (
        '[[session]]\nname = "{0}"\ncalibration = "{0}/calibration.toml"\ndetections = "{0}/detections"\n{1}'
    )
    shared = '[defaults]\nunit = "m"\nlayout = "body25b"\nfps = 60\n'
    sessions = [session.format("demo", ""), session.format("people", 'people = "all"\n')]
    (folder / "sessions.toml").write_text("\n".join([shared, *sessions]))
    _write_simulated(folder)


def _write_simulated(folder: Path) -> None:
    mark = {"format": "skelsplat-calibration", "version": 1}
    for name, seed, frames in (("long", 5, 30_000), ("live", 6, 80)):
        K, R, t, _, detected = scene(seed, frames=frames)
        cameras = [
            {"name": f"c{i}", "size": [1920, 1080], "K": K.tolist(), "R": R[i].tolist(), "t": t[i].tolist()}
            | {"distortion": None, "fisheye": False}
            for i in range(len(R))
        ]
        (folder / f"{name}.json").write_text(json.dumps({**mark, "unit": "mm", "cameras": cameras}))
        if name == "long":
            names = np.array([camera["name"] for camera in cameras])
            np.savez(folder / "long.npz", detections=detected, camera_names=names)
            continue
        lines = [json.dumps({"frame": f, "detections": frame.tolist()}) for f, frame in enumerate(detected)]
        (folder / "live.jsonl").write_text("\n".join([*lines[:40], "{}", *lines[40:]]) + "\n")
    K, R, t, _, detected = scene(7, frames=50, cameras=3)
    names = (
        "nose left_eye right_eye left_ear right_ear left_shoulder right_shoulder left_elbow right_elbow "
        "left_wrist right_wrist left_hip right_hip left_knee right_knee left_ankle right_ankle"
    )
    dlc = folder / "dlc"
    (dlc / "detections").mkdir(parents=True)
    import cv2

    text = []
    for i in range(3):
        rotation = ", ".join(f"{x:.17g}" for x in cv2.Rodrigues(R[i])[0].ravel())
        text.append(
            f'[cam_{i}]\nname = "cam{i}"\nsize = [1920, 1080]\nmatrix = {K.tolist()}\n'
            f"distortions = [-0.05, 0.01, 0.0, 0.0, 0.0]\nrotation = [{rotation}]\n"
            f"translation = {(t[i] / 10).tolist()}\n"
        )
        rows = [["scorer"] + ["D"] * 51, ["bodyparts"], ["coords"] + ["x", "y", "likelihood"] * 17]
        for joint in names.split():
            rows[1] += [joint] * 3
        for f, frame in enumerate(detected[:, i]):
            rows.append([str(f), *("" if np.isnan(x) else f"{x:.3f}" for x in frame.ravel())])
        (dlc / "detections" / f"cam{i}.csv").write_text("\n".join(",".join(row) for row in rows) + "\n")
    (dlc / "calibration.toml").write_text("\n".join(text))


def compare(before: Path, after: Path, only: list[str]) -> int:
    """Print every difference between two frozen sets; 1 if there is one."""
    differences = 0
    for name in only:
        files = sorted(path for path in (before / name).rglob("*") if path.is_file())
        namesakes: dict[str, list[Path]] = {}
        for path in (after / name).rglob("*"):
            namesakes.setdefault(path.name, []).append(path)
        found = [
            text
            for path in files
            for text in _differences(path, after / path.relative_to(before), namesakes.get(path.name, ()))
        ]
        print(f"{name}: {len(files)} files, {'as before' if not found else f'{len(found)} differences'}")
        for text in found[:12]:
            print(f"  {text}")
        differences += len(found)
    return int(differences > 0)


def _differences(a: Path, b: Path, renamed: Sequence[Path] = ()) -> list[str]:
    """Return what differs between two files; ``renamed`` may hold ``b`` if it is not in its place."""
    if a.suffix in PAGES or a.name.startswith(".") or "cache" in str(a):
        return []
    if not b.exists():
        return [] if renamed and any(not _differences(a, c) for c in renamed) else [f"{b}: missing"]
    if a.suffix == ".npz":
        return [f"{b}: {text}" for text in _arrays_differ(a, b)]
    if a.suffix == ".json" and a.stat().st_size:
        try:
            return [f"{b}: {text}" for text in _numbers_differ(_documents(a), _documents(b))]
        except json.JSONDecodeError:
            return []  # what people read
    if a.suffix == ".csv":
        return [f"{b}: a number differs"] if _table(a) != _table(b) else []
    if a.suffix in {".trc", ".c3d"} and a.read_bytes() != b.read_bytes():
        return [f"{b}: bytes differ"]
    return []


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
    return [
        [row[k] for k in keep if k < len(row) and _is_number(row[k])] for row in rows if "ms" not in row
    ]  # rows of times


def _is_number(text: str) -> bool:
    return re.fullmatch(r"[-+]?[\d.]+(e[-+]?\d+)?|nan|-?inf", text, re.IGNORECASE) is not None


def _arrays_differ(a: Path, b: Path) -> list[str]:
    found = []
    with np.load(a, allow_pickle=False) as old, np.load(b, allow_pickle=False) as new:
        for key in old.files:
            if VOLATILE.search(key):
                continue
            if key not in new.files:
                found.append(f"{key}: missing")
            elif old[key].dtype.kind in "US" or new[key].dtype.kind in "US":
                if not np.array_equal(old[key], new[key]):
                    found.append(f"{key}: words differ")
            elif old[key].tobytes() != new[key].tobytes():
                found.append(f"{key}: bits differ")
    return found


def _numbers_differ(a: Any, b: Any) -> list[str]:
    old, new = dict(_leaves(a)), dict(_leaves(b))
    gone = [(key, value) for key, value in old.items() if new.get(key) != value]
    rest = Counter(value for key, value in new.items() if old.get(key) != value)
    found = []
    for key, value in gone:
        if rest[value] > 0:  # under another key
            rest[value] -= 1
        else:
            found.append(f"{key}: {value} became {new.get(key, 'nothing')}")
    return found


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
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(dest="command", required=True)
    for command in ("make", "compare"):
        one = commands.add_parser(command)
        one.add_argument("folders", type=Path, nargs=1 if command == "make" else 2)
        one.add_argument("--only", action="append", choices=names)
        if command == "make":
            one.add_argument("--python", default=sys.executable)
            one.add_argument("--inputs", type=Path, help="folder of a frozen set whose input files are used")
    commands.add_parser("list")
    commands.add_parser("arrays").add_argument("folder", type=Path)
    given = parser.parse_args()
    if given.command == "list":
        print("\n".join(names))
        return 0
    if given.command == "arrays":
        arrays(given.folder)
        return 0
    only = given.only or names
    if given.command == "compare":
        return compare(*given.folders, only)
    (out,) = given.folders
    return make(out, given.python, (given.inputs or out) / "inputs", only)


if __name__ == "__main__":
    sys.exit(main())
