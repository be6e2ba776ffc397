"""Attacks with several people in view: a run that mixes them must report it."""

from __future__ import annotations

import contextlib
import io
import json
import shutil
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray
from scenarios import DATA

import skelsplat as sk
from skelsplat import synthetic
from skelsplat.cli import app
from skelsplat.io import write_calibration

from . import attack

_TRIAL = DATA / "pose2sim_demo"
_FRAMES = 60
# Findings of this kind: name in the table, and kind.
_KINDS = {
    "people mixed": "people_mixed",
    "2 visible": "people_visible",
    "limbs vary": "limb_lengths_vary",
    "rejected": "many_rejected",
    "one followed": "person_followed",
    "an entry": "person_by_place",
}


def _write(folder: Path, people: NDArray[np.float64], cameras: list[str]) -> Path:
    """Write people (T, M, P, K, 3), NaN for no person, as OpenPose's folders of JSON files."""
    for i, camera in enumerate(cameras):
        (folder / camera).mkdir(parents=True)
        for t, everybody in enumerate(people[:, i]):
            there = [person for person in everybody if np.isfinite(person[:, 0]).any()]
            entries = [{"pose_keypoints_2d": np.nan_to_num(person).ravel().tolist()} for person in there]
            (folder / camera / f"{camera}_{t:06d}_keypoints.json").write_text(json.dumps({"people": entries}))
    return folder


def _run(*arguments: object) -> str:
    """Run the command line; return its exit status and its findings of this kind."""
    with TemporaryDirectory() as out:
        status = 0
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            try:
                app([*map(str, arguments), "-o", out])
            except SystemExit as end:
                status = int(end.code or 0)
        path = Path(out) / "report.json"
        findings = [one["kind"] for one in json.loads(path.read_text())["findings"]] if path.is_file() else []
    given = [name for name, kind in _KINDS.items() if kind in findings]
    return f"exit {status}; {', '.join(given) or 'none of this kind'}"


def _trial(person: str, *more: object) -> str:
    if not (_TRIAL / "pose2sim_demo.npz").is_file():
        return "skipped: the recording is not here"
    with np.load(_TRIAL / "pose2sim_demo.npz") as archive:
        people, cameras = archive["two_persons_det2d"].astype(float), archive["camera_names"].tolist()
    people[people[..., 2] <= 0] = np.nan
    with TemporaryDirectory() as folder:
        calibration = Path(shutil.copy(_TRIAL / "Calib_qualisys.toml", folder))
        pose = _write(Path(folder) / "pose", people, cameras)
        given = ("refine", calibration, pose, "--unit", "m", "--layout", "body25b", "--person", person)
        return _run(*given, *more)


def _simulated(person: str) -> str:
    rig = synthetic.human36m_like()
    found = []
    for sign, seed in ((1.0, 1), (-1.0, 7)):
        pose = synthetic.motion("walk", _FRAMES, seed=seed)
        pose[..., :2] -= pose[:, :1, :2]
        pose[..., 0] += sign * np.linspace(-900.0, 900.0, _FRAMES)[:, None]
        pose[..., 1] -= sign * 300.0
        noise = synthetic.DetectionNoise.good()
        found.append(np.asarray(synthetic.simulate_detections(pose, rig, noise=noise, seed=seed)))
    people = np.stack(found, axis=2)
    order = np.argsort(np.random.default_rng(2).random(people.shape[:3]), axis=2)
    people = np.take_along_axis(people, order[..., None, None], axis=2)
    with TemporaryDirectory() as folder:
        calibration = Path(folder) / "Calib.toml"
        write_calibration(calibration, sk.CameraRig(rig, unit="mm"))
        pose = _write(Path(folder) / "pose", people, list(rig.names))
        return _run(
            "refine", calibration, pose, "--unit", "mm", "--layout", "h36m17", "--fps", 50, "--person", person
        )


@attack("7a", "two people (real), --person 0 at 60 Hz: findings", "one followed")
def two_people_real() -> str:
    return _trial("0", "--fps", 60)


@attack("7b", "two people (real), the default person", "2 visible")
def two_people_real_consistent() -> str:
    return _trial("consistent", "--fps", 60)


@attack("7c", "two people (simulated, crossing), --person 0", "one followed")
def two_people_simulated() -> str:
    return _simulated("0")


@attack("7d", "two people (simulated, crossing), default", "2 visible")
def two_people_simulated_consistent() -> str:
    return _simulated("consistent")


@attack("7e", "embedded demo: findings of this kind", "none of this kind")
def demo_people() -> str:
    return _run("demo")


@attack(
    "7h",
    "two people (real), --person 0, no frame rate",
    "people mixed, 2 visible, limbs vary, rejected, an entry",
)
def two_people_real_by_place() -> str:
    return _trial("0")
