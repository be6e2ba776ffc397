"""Attacks on the numbers of recordings: what must agree and does not, and error bars that claim too much."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

import skelsplat as sk
from skelsplat import synthetic
from skelsplat.io import PoseData, read_pose, write_pose

from . import attack

Array = NDArray[np.float64]

_FPS = 50.0
_LAYOUT = "h36m17"
# A world with its origin far away, as map coordinates have it, mm
_UTM = np.array([5.0e8, 5.2e9, 1.0e5])


@dataclass(frozen=True)
class _Recording:
    """A motion (T, 17, 3) and what cameras detect of it (T, M, 17, 2|3)."""

    truth: Array
    detections: Array
    cameras: sk.CameraRig

    def solved(self, fps: float = _FPS) -> sk.SequenceRefinement:
        return sk.refine_sequence(self.detections, self.cameras, fps=fps, layout=_LAYOUT)


def _walk(seed: int = 0, frames: int = 120, *, noise: str = "good", fps: float = _FPS) -> _Recording:
    truth = synthetic.motion("walk", frames, seed=seed, fps=fps)
    rig = synthetic.human36m_like()
    kinds = {
        "good": synthetic.DetectionNoise.good(),
        "occluded": synthetic.DetectionNoise.recording_occluded(2),
    }
    found = synthetic.simulate_detections(truth, rig, noise=kinds[noise], seed=seed)
    return _Recording(truth, np.asarray(found), rig)


def _close_cameras(apart_mm: float, seed: int) -> _Recording:
    """Return a walk 3 m before two parallel cameras, with white noise of 2 px."""
    truth = synthetic.motion("walk", 120, seed=seed)
    middle = truth[:, :1].mean(axis=0)
    K = np.array([[800.0, 0.0, 500.0], [0.0, 800.0, 500.0], [0.0, 0.0, 1.0]])
    R, _ = synthetic.look_at(middle[0] + [3000.0, 0.0, 0.0], middle[0])
    eyes = [middle[0] + [3000.0, k * apart_mm, 0.0] for k in range(2)]
    rig = sk.CameraRig([sk.Camera(K, R, -R @ eye, size=(1000, 1000)) for eye in eyes])
    pixels = np.moveaxis(sk.project(truth, rig), 0, 1)
    return _Recording(truth, pixels + 2.0 * np.random.default_rng(seed).standard_normal(pixels.shape), rig)


def _claims(pairs: list[tuple[sk.SequenceRefinement, Array]], status: str = "ok") -> str:
    """Return the error of joints of this status, and how often it is within or far beyond their bars."""
    error, bars = [], []
    for result, truth in pairs:
        there = result.joint_status == status
        error.append((result.pose - truth)[there])
        bars.append(result.uncertainty[there])
    e, covariance = np.concatenate(error), np.concatenate(bars)
    share = len(e) / sum(result.joint_status.size for result, _ in pairs)
    if not len(e):
        return f"0 % {status}"
    if not np.isfinite(e).all():
        return f"{100 * share:.0f} % {status}, {100 * np.isnan(e).any(axis=-1).mean():.0f} % of them nowhere"
    far = np.sqrt(np.einsum("ni,nij,nj->n", e, np.linalg.inv(covariance), e))
    return (
        f"{100 * share:.0f} % {status}, error {np.linalg.norm(e, axis=-1).mean():.0f} mm, "
        f"{100 * (far < 3).mean():.0f} % within 3 σ, {100 * (far > 5).mean():.1f} % beyond 5 σ"
    )


def _largest(found: Array, expected: Array) -> float:
    if (np.isnan(found) != np.isnan(expected)).any():
        return float("inf")
    return float(np.nanmax(np.abs(found - expected)))


@attack("15a", "a recording in which nothing ever moves", "as a frame")
def still_detections() -> str:
    seen = _walk()
    still = _Recording(seen.truth, np.repeat(seen.detections[:1], 120, axis=0), seen.cameras)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = still.solved()
    status, count = np.unique(found.joint_status, return_counts=True)
    states = ", ".join(f"{n} {name}" for name, n in zip(status, count, strict=True))
    missing = np.isnan(found.pose).any(axis=-1).mean()
    return f"{states}; {100 * missing:.0f} % without a position"


def _still(frames: int) -> str:
    pairs = []
    for seed in range(20):
        seen = _walk(seed, 2)
        still = _Recording(seen.truth, np.repeat(seen.detections[:1], frames, axis=0), seen.cameras)
        pairs.append((still.solved(), np.repeat(seen.truth[:1], frames, axis=0)))
    return _claims(pairs)


@attack("15b", "the same: error bars, 20 recordings of 2.4 s", "97 % within 3 σ")
def error_bars_of_still_detections() -> str:
    return _still(120)


@attack("15n", "the same, 20 recordings of 6 s", "97 % within 3 σ")
def error_bars_of_still_detections_for_6_s() -> str:
    return _still(300)


@attack("15c", "two cameras 150 mm apart, 3 m away: recordings", "97 % within 3 σ")
def recordings_by_cameras_150_mm_apart() -> str:
    seen = [_close_cameras(150.0, seed) for seed in range(5)]
    return _claims([(one.solved(), one.truth) for one in seen])


@attack("15d", "two cameras 300 mm apart: recordings", "97 % within 3 σ")
def recordings_by_cameras_300_mm_apart() -> str:
    seen = [_close_cameras(300.0, seed) for seed in range(5)]
    return _claims([(one.solved(), one.truth) for one in seen])


@attack("15e", "two cameras 70 mm apart: joints that are inferred", "none")
def recordings_by_cameras_70_mm_apart() -> str:
    seen = [_close_cameras(70.0, seed) for seed in range(5)]
    return _claims([(one.solved(), one.truth) for one in seen], "inferred")


@attack("15f", "a frame every ten seconds: velocities", "none")
def velocities_over_ten_seconds() -> str:
    seen = _walk(fps=0.1)
    found = seen.solved(0.1)
    error = found.velocity - np.gradient(seen.truth, 10.0, axis=0)
    known = np.isfinite(error).all(axis=-1)
    if not known.any():
        return "none"
    e, covariance = error[known], found.velocity_uncertainty[known]
    far = np.sqrt(np.einsum("ni,nij,nj->n", e, np.linalg.inv(covariance), e))
    return f"{known.sum()} velocities, {100 * (far > 10).mean():.0f} % beyond ten error bars"


@attack("15g", "a C3D file of a world in UTM coordinates, read again", "as written, or refused")
def c3d_far_from_the_origin() -> str:
    pose = synthetic.motion("walk", 4, seed=0) + _UTM
    names = sk.layouts.H36M17.joints
    data = PoseData(pose=pose, joint_names=tuple(names), frames=np.arange(1, 5), unit="mm", frame_rate=50.0)
    with TemporaryDirectory() as folder:
        try:
            write_pose(Path(folder) / "pose.c3d", data)
        except sk.InvalidInputError as error:
            return f"InvalidInputError: {str(error).split(':')[0]}"
        return f"off by up to {_largest(read_pose(Path(folder) / 'pose.c3d').pose, pose):.0f} mm"


@attack("15h", "a rig in centimetres that is stated to be in millimetres", "a warning")
def centimetres_taken_for_millimetres() -> str:
    seen = _walk()
    rig = sk.CameraRig([sk.Camera(c.K, c.R, c.t / 10.0, size=c.size) for c in seen.cameras])
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        found = sk.refine(None, seen.detections, rig, layout=_LAYOUT)
    warned = f"warns: {caught[0].message}" if caught else "no warning"
    return f"{100 * (found.joint_status == 'ok').mean():.0f} % ok; {warned}"


def _mirrored(seen: _Recording) -> tuple[_Recording, list[int]]:
    """Return the recording in a mirror, and where each joint is then."""
    flip = np.diag([-1.0, 1.0, 1.0])
    found = seen.detections.copy()
    cameras = []
    for i, camera in enumerate(seen.cameras):
        cameras.append(sk.Camera(camera.K, flip @ camera.R @ flip, flip @ camera.t, size=camera.size))
        found[:, i, :, 0] = 2.0 * camera.K[0, 2] - found[:, i, :, 0]
    other = list(range(17))
    for left, right in sk.layouts.H36M17.left_right:
        other[left], other[right] = right, left
    return _Recording(seen.truth * [-1.0, 1.0, 1.0], found[:, :, other], sk.CameraRig(cameras)), other


@attack("15i", "recordings reversed, moved, turned, mirrored, in m, cameras in another order", "same")
def recordings_that_must_agree() -> str:
    seen = _walk(noise="occluded")
    base = seen.solved()
    worst = {}
    back = _Recording(seen.truth, seen.detections[::-1], seen.cameras).solved()
    worst["reversed"] = _largest(back.pose[::-1], base.pose)
    worst["velocity"] = _largest(-back.velocity[::-1], base.velocity)
    q, _ = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))
    q *= np.linalg.det(q)
    moved = [sk.Camera(c.K, c.R @ q.T, c.t - c.R @ q.T @ _UTM, size=c.size) for c in seen.cameras]
    found = _Recording(seen.truth, seen.detections, sk.CameraRig(moved)).solved()
    worst["UTM"] = _largest((found.pose - _UTM) @ q, base.pose)
    metres = [sk.Camera(c.K, c.R, c.t / 1000.0, size=c.size) for c in seen.cameras]
    found = _Recording(seen.truth, seen.detections, sk.CameraRig(metres, unit="m")).solved()
    worst["metres"] = _largest(found.pose * 1000.0, base.pose)
    mirrored, other = _mirrored(seen)
    worst["mirrored"] = _largest((mirrored.solved().pose * [-1.0, 1.0, 1.0])[:, other], base.pose)
    order = [2, 0, 3, 1]
    shuffled = sk.CameraRig([seen.cameras[i] for i in order])
    worst["order"] = _largest(
        _Recording(seen.truth, seen.detections[:, order], shuffled).solved().pose, base.pose
    )
    return "mm: " + ", ".join(f"{name} {value:.0e}" for name, value in worst.items())


@attack("15j", "people in another order of slots and cameras, in m, in UTM coordinates", "same")
def people_that_must_agree() -> str:
    scene = synthetic.simulate_scene(3, synthetic.ring(4, radius_mm=4500), n_frames=100, seed=1)
    people, rig = np.asarray(scene.people), scene.cameras

    def tracked(array: Array, cameras: sk.CameraRig) -> list[Array]:
        found = sk.track(array, cameras, fps=30, layout=_LAYOUT)
        return [person.refinement.pose for person in found]

    base = tracked(people, rig)
    rng = np.random.default_rng(0)
    slots = people.copy()
    for frame in slots:
        for view in frame:
            view[:] = view[rng.permutation(len(view))]
    order = [2, 0, 3, 1]
    metres = [sk.Camera(c.K, c.R, c.t / 1000.0, size=c.size) for c in rig]
    far = [sk.Camera(c.K, c.R, c.t - c.R @ _UTM, size=c.size) for c in rig]
    cases = {
        "slots": tracked(slots, rig),
        "order": tracked(people[:, order], sk.CameraRig([rig[i] for i in order])),
        "metres": [1000.0 * pose for pose in tracked(people, sk.CameraRig(metres, unit="m"))],
        "UTM": [pose - _UTM for pose in tracked(people, sk.CameraRig(far))],
    }
    worst = {
        name: max(map(_largest, found, base)) if len(found) == len(base) else float("inf")
        for name, found in cases.items()
    }
    return f"{len(base)} people; mm: " + ", ".join(f"{name} {value:.0e}" for name, value in worst.items())


@attack("15k", "detections rounded to 8 px, the stride of a heat map: recordings", "97 % within 3 σ")
def detections_rounded_to_8_px() -> str:
    pairs = []
    for seed in range(5):
        seen = _walk(seed)
        pixels = np.moveaxis(sk.project(seen.truth, seen.cameras), 0, 1)
        rounded = _Recording(seen.truth, np.round(pixels / 8.0) * 8.0, seen.cameras)
        pairs.append((rounded.solved(), seen.truth))
    return _claims(pairs)


@attack("15l", "every frame four times: a video of 12.5 Hz stored at 50 Hz", "97 % within 3 σ")
def frames_four_times() -> str:
    pairs = []
    for seed in range(5):
        seen = _walk(seed)
        held = _Recording(seen.truth, seen.detections[np.arange(120) // 4 * 4], seen.cameras)
        pairs.append((held.solved(), seen.truth))
    return _claims(pairs)


@attack("15m", "left and right exchanged in two of four views, always", "not ok")
def sides_exchanged_in_half_of_the_views() -> str:
    pairs = []
    other = _mirrored(_walk())[1]
    for seed in range(5):
        seen = _walk(seed)
        found = seen.detections.copy()
        found[:, :2] = found[:, :2][:, :, other]
        pairs.append((_Recording(seen.truth, found, seen.cameras).solved(), seen.truth))
    return _claims(pairs)
