"""Rigs, detections and faults of them for the tests of `skelsplat.rig_check`."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import skelsplat as sk
from skelsplat import synthetic
from skelsplat.cameras import altered
from skelsplat.cameras import matrix_from_vector as rotation
from skelsplat.io import read_calibration, read_detections, sample

T = 24
LAYOUT = "h36m17"


@cache
def rig(name):
    return {
        "room": lambda: synthetic.human36m_like(distortion=True),
        "dome of 3": lambda: synthetic.dome(3),
        "dome of 6": lambda: synthetic.dome(6),
        "ring of 4": lambda: synthetic.ring(4),
        "pair": synthetic.stereo,
    }[name]()


@cache
def detections(name, motion="walk", noise="good", steps=T):
    kind = {
        "good": synthetic.DetectionNoise.good,
        "noisy": synthetic.DetectionNoise.noisy,
        "occluded": lambda: synthetic.DetectionNoise.occluded(2),
    }[noise]()
    found = synthetic.simulate_detections(
        synthetic.motion(motion, steps, seed=1), rig(name), noise=kind, seed=3
    )
    found.setflags(write=False)
    return found


@cache
def recording():
    """Return cameras and people of the recording in the package, every fifth frame."""
    with TemporaryDirectory() as folder:
        paths = sample.extract(Path(folder))
        cameras = read_calibration(paths.calibration, unit=sample.UNIT)
        return cameras, read_detections(paths.detections, cameras, layout=sample.LAYOUT).people[::5]


def mirrored(found, name):
    """Return detections (T, M, N, 3) of mirrored images of a rig's cameras."""
    changed = found.copy()
    changed[..., 0] = np.array([camera.size[0] for camera in rig(name)])[:, None] - 1 - found[..., 0]
    return changed


def replaced(cameras, view, **changes):
    """Return the rig with K, R, t or the size of one camera changed."""
    made = [altered(one, **changes) if i == view else one for i, one in enumerate(cameras)]
    return sk.CameraRig(made, unit=cameras.unit)


def turned(cameras, view, degrees, axis=None):
    """Return the rig as calibrated before a camera was turned about an axis, or by three angles."""
    vector = np.radians(degrees) * (1 if axis is None else np.array(axis) / np.linalg.norm(axis))
    turn, camera = rotation(vector), cameras[view]
    return replaced(cameras, view, R=turn @ camera.R, t=turn @ camera.t)


def only(report):
    """Return the one finding of a report."""
    assert len(report.findings) == 1, [finding.text for finding in report.findings]
    return report.findings[0]
