"""Attacks with a wrong calibration of one camera, which a run must report."""

from __future__ import annotations

import contextlib
import io
import json
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import skelsplat as sk
from skelsplat import synthetic
from skelsplat.cli import app
from skelsplat.io import write_calibration

from . import attack

_FRAMES = 60
# Scatter of every detection besides that of a good detector, as in the embedded demo: 30 mm at the person.
_NOISE_PX = 8.0
_TURNED, _DEGREES = "cam2", 1.5


def _turned(rig: sk.CameraRig) -> sk.CameraRig:
    """Return the rig with one camera rotated about its own vertical axis."""
    angle = np.radians(_DEGREES)
    turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    cameras = [
        sk.Camera(camera.K, turn @ camera.R, turn @ camera.t, size=camera.size, name=camera.name)
        if camera.name == _TURNED
        else camera
        for camera in rig
    ]
    return sk.CameraRig(cameras, unit="mm")


def _findings(rig: sk.CameraRig, calibrated: sk.CameraRig) -> str:
    """Refine detections of one rig with the calibration of another; return which cameras are reported."""
    pose = synthetic.motion("walk", _FRAMES, seed=3)
    noise = synthetic.DetectionNoise.good()
    found = np.asarray(synthetic.simulate_detections(pose, rig, noise=noise, seed=3)).copy()
    found[..., :2] += np.random.default_rng(0).normal(0.0, _NOISE_PX, found[..., :2].shape)
    with TemporaryDirectory() as folder:
        calibration, detections = Path(folder) / "Calib.toml", Path(folder) / "detections.npz"
        write_calibration(calibration, calibrated)
        np.savez(
            detections,
            detections=found,
            camera_names=np.array(rig.names),
            joint_names=np.array(sk.layouts.H36M17.joints),
        )
        arguments = ["refine", calibration, detections, "--unit", "mm", "--layout", "h36m17", "--fps", 50]
        status = 0
        out = Path(folder) / "out"
        text = io.StringIO()
        with contextlib.redirect_stdout(text), contextlib.redirect_stderr(text):
            try:
                app([*map(str, arguments), "-o", str(out)])
            except SystemExit as end:
                status = int(end.code or 0)
        path = out / "report.json"
        if not path.is_file():
            return f"exit {status}; {text.getvalue()[-120:]}"
        findings = json.loads(path.read_text())["findings"]
    about = [one for one in findings if one["kind"] in ("camera_disagrees", "camera_displaced")]
    first = [one["subject"]["cameras"][0] for one in about]
    return f"exit {status}; {', '.join(first) or 'no finding'}"


@attack("7f", "a camera rotated by 1.5°, simulated: finding", f"{_TURNED} is named")
def turned_camera() -> str:
    rig = synthetic.human36m_like()
    return _findings(rig, _turned(rig))


@attack("7g", "the same with the right calibration", "no finding")
def sound_cameras() -> str:
    rig = synthetic.human36m_like()
    return _findings(rig, rig)
