"""Cameras at the same position, contradicting views, degenerate poses and priors."""

from __future__ import annotations

import numpy as np
from scenarios import FloatArray, cmu_poses, rig

import skelsplat as sk
from attacks import attack
from skelsplat import synthetic

_WRIST = 16
_SIGMA_PX = 2.0


def _detections(truth: FloatArray, cameras: sk.CameraRig, seed: int = 0) -> FloatArray:
    """Projections (T, M, N, 2) with normal noise of 2 px."""
    pixels = np.moveaxis(sk.project(truth, cameras), 0, 1)
    return pixels + _SIGMA_PX * np.random.default_rng(seed).standard_normal(pixels.shape)


def _wide(camera: sk.Camera) -> sk.Camera:
    """Return a camera with a lens of half the focal length in the same housing."""
    K = camera.K * [[0.5], [0.5], [1.0]]
    K[:2, 2] = camera.K[:2, 2]
    return sk.Camera(K, camera.R, camera.t, size=camera.size)


def _pair(apart_mm: float) -> sk.CameraRig:
    """Two cameras side by side, 3 m from the origin at the height of the chest."""
    K = np.array([[1100.0, 0, 960], [0, 1100, 540], [0, 0, 1]])
    R = np.array([[0.0, 1, 0], [0, 0, -1], [-1, 0, 0]])
    centres = [np.array([3000.0, k * apart_mm, 1000.0]) for k in range(2)]
    return sk.CameraRig([sk.Camera(K, R, -R @ c, size=(1920, 1080)) for c in centres])


def _judged(result: sk.Refinement, truth: FloatArray, joints: slice | int) -> str:
    """Share of ok joints, their median error, median error bar and the share beyond ten error bars."""
    ok = np.atleast_2d(result.joint_status[:, joints] == "ok").reshape(-1)
    error = (result.pose - truth)[:, joints].reshape(-1, 3)[ok]
    bars = result.uncertainty[:, joints].reshape(-1, 3, 3)[ok]
    if not ok.any():
        return "0 % ok"
    length = np.linalg.norm(error, axis=1)
    bar = np.sqrt(np.trace(bars, axis1=1, axis2=2))
    beyond = 100 * np.mean(length > 10 * bar)
    return (
        f"{100 * ok.mean():.0f} % ok, error {np.median(length):.3g} mm, "
        f"bar {np.median(bar):.2g} mm, {beyond:.0f} % beyond ten bars"
    )


@attack("2a", "a wrist seen only by one camera and by a wide lens in its housing (200 frames)", "0 % ok")
def wide_lens_in_one_housing() -> str:
    cameras = rig("room", 4)
    cameras = sk.CameraRig([*cameras, _wide(cameras[0])])
    truth = cmu_poses(200, 0)
    detections = _detections(truth, cameras)
    detections[:, 1:4, _WRIST] = np.nan
    return _judged(sk.refine(None, detections, cameras, layout="h36m17"), truth, _WRIST)


def _side_by_side(apart_mm: float) -> str:
    cameras, truth = _pair(apart_mm), cmu_poses(100, 0)
    result = sk.refine(None, _detections(truth, cameras), cameras, layout="h36m17")
    return _judged(result, truth, slice(None))


@attack("2b", "two cameras 1 mm apart at 3 m", "0 % ok")
def cameras_1_mm_apart() -> str:
    return _side_by_side(1.0)


@attack("2c", "two cameras 3 mm apart at 3 m", "0 % beyond")
def cameras_3_mm_apart() -> str:
    return _side_by_side(3.0)


@attack("2d", "two cameras at exactly the same position", "0 % ok")
def cameras_in_one_place() -> str:
    return _side_by_side(0.0)


@attack("2e", "two cameras 200 mm apart at 3 m: a small stereo rig", "ok, 0 % beyond")
def cameras_200_mm_apart() -> str:
    return _side_by_side(200.0)


def _arm_exchanged(truth: FloatArray, cameras: sk.CameraRig) -> tuple[FloatArray, np.ndarray]:
    """Simulate detections with the arms swapped in one of the views; also return where (T, M, N)."""
    detections = _detections(truth, cameras)
    exchanged = np.zeros(detections.shape[:3], bool)
    view = np.random.default_rng(1).integers(detections.shape[1], size=len(truth))
    pairs = np.array(sk.layouts.H36M17.left_right)
    names = sk.layouts.H36M17.joints
    for left, right in pairs[[any(w in names[a].lower() for w in ("sho", "elb", "wri")) for a, _ in pairs]]:
        for t, i in enumerate(view):
            detections[t, i, [left, right]] = detections[t, i, [right, left]]
            exchanged[t, i, [left, right]] = True
    return detections, exchanged


def _with_empty(n: int) -> str:
    truth, cameras = cmu_poses(200, 0), rig("room", 3)
    detections, exchanged = _arm_exchanged(truth, cameras)
    cameras = sk.CameraRig([*cameras, *list(rig("room", 3 + n))[3:]])
    empty = np.full((len(truth), n, *detections.shape[2:]), np.nan)
    result = sk.refine(None, np.concatenate([detections, empty], axis=1), cameras, layout="h36m17")
    found = (result.swapped[:, :3] == exchanged).all(axis=(1, 2)).mean()
    error = np.linalg.norm(result.pose - truth, axis=-1)
    off = np.mean(error[result.joint_status == "ok"] > 100)
    return f"{100 * found:.1f} % found, mean {np.nanmean(error):.1f} mm, {100 * off:.1f} % ok and 100 mm off"


@attack("3a", "arms swapped in one of three views", "found")
def exchange_in_three_views() -> str:
    return _with_empty(0)


@attack("3b", "the same and two cameras that detect nothing", "as 3a")
def exchange_and_two_empty() -> str:
    return _with_empty(2)


@attack("3c", "the same and four cameras that detect nothing", "as 3a")
def exchange_and_four_empty() -> str:
    return _with_empty(4)


@attack("3d", "order of six to ten cameras, swaps and outliers, 3,600 permutations", "0 differ")
def order_of_cameras() -> str:
    rng = np.random.default_rng(0)
    noise = synthetic.DetectionNoise(
        sigma_px=3.0, outlier_rate=0.15, outlier_px=150.0, limb_swap_rate=0.2, view_swap_rate=0.05
    )
    differ, worst = 0, 0.0
    for n_views in (6, 8, 10):
        cameras, truth = rig("room", n_views), cmu_poses(60, n_views)
        detections = synthetic.simulate_detections(truth, cameras, noise=noise, seed=n_views)
        base = sk.refine(None, detections, cameras, layout="h36m17").pose
        for _ in range(20):
            order = rng.permutation(n_views)
            shuffled = sk.CameraRig([cameras[int(i)] for i in order])
            pose = sk.refine(None, detections[:, order], shuffled, layout="h36m17").pose
            moved = np.nanmax(np.linalg.norm(pose - base, axis=-1), axis=1)
            differ, worst = differ + int((moved > 1e-3).sum()), max(worst, float(moved.max()))
    return f"{differ} differ, worst {worst:.3g} mm"


def _moved_by_empty(method: str) -> str:
    truth, cameras = cmu_poses(100, 0), rig("room", 5)
    detections = synthetic.simulate_detections(truth, cameras, noise=synthetic.DetectionNoise.noisy(), seed=0)
    few = sk.CameraRig(list(cameras)[:4])
    plain = sk.triangulate(detections[:, :4], few, method=method)
    detections[:, 4] = np.nan
    with_empty = sk.triangulate(detections, cameras, method=method)
    return f"moves by up to {np.nanmax(np.linalg.norm(plain - with_empty, axis=-1)):.2g} mm"


@attack("3e", "triangulate by DLT, an empty camera added", "0 mm")
def empty_camera_and_dlt() -> str:
    return _moved_by_empty("dlt")


@attack("3f", "triangulate by RANSAC, an empty camera added", "0 mm")
def empty_camera_and_ransac() -> str:
    return _moved_by_empty("ransac")


def _two_people(frames: int = 30) -> tuple[FloatArray, FloatArray, sk.CameraRig]:
    """Simulate a walk, and detections in which two of four views show another person from frame 10 on."""
    cameras = rig("room", 4)
    truth = synthetic.motion("walk", frames, seed=0)
    other = synthetic.motion("walk", frames, seed=5) + np.array([600.0, 300.0, 0.0])
    detections, of_other = _detections(truth, cameras), _detections(other, cameras, 1)
    detections[10:, 2:] = of_other[10:, 2:]
    return truth, detections, cameras


def _far(pose: FloatArray, truth: FloatArray, status: np.ndarray, bars: FloatArray) -> str:
    error = pose - truth
    length = np.linalg.norm(error, axis=-1)
    squared = np.einsum("tni,tnij,tnj->tn", error, np.linalg.inv(bars), error)
    ok = status == "ok"
    off = length > 100
    return (
        f"{100 * ok.mean():.0f} % ok, of these {100 * np.mean(off[ok]) if ok.any() else 0:.0f} % 100 mm off; "
        f"mean {length.mean():.0f} mm, {100 * np.mean(squared < 9):.0f} % within 3 σ"
    )


@attack("8a", "two of four views show another person, each frame alone", "weak, within 3 σ")
def half_of_the_views_single() -> str:
    truth, detections, cameras = _two_people()
    result = sk.refine(None, detections, cameras, layout="h36m17")
    at = slice(10, None)
    return _far(result.pose[at], truth[at], result.joint_status[at], result.uncertainty[at])


@attack("8b", "the same in Refiner.step, after ten good frames", "weak, error small")
def half_of_the_views_in_sequence() -> str:
    truth, detections, cameras = _two_people()
    refiner = sk.Refiner(cameras, layout="h36m17")
    steps = [refiner.step(frame) for frame in detections][10:]
    pose, status, bars = (
        np.stack([getattr(s, n) for s in steps]) for n in ("pose", "joint_status", "uncertainty")
    )
    return _far(pose, truth[10:], status, bars)


@attack(
    "8c", "Refiner.step, good simulated detections, pairs of views on another person", "weak, error small"
)
def half_of_the_views_with_outliers() -> str:
    cameras, good = rig("room", 4), synthetic.DetectionNoise.good()
    errors, statuses = [], []
    for seed in range(3):
        truth = synthetic.motion("walk", 40, seed=seed)
        for views in ([1, 3], [0, 2], [0, 1]):
            seen = synthetic.simulate_detections(truth, cameras, noise=good, seed=seed)
            other = synthetic.simulate_detections(
                truth + np.array([600.0, 0, 0]), cameras, noise=good, seed=50 + seed
            )
            seen[10:, views] = other[10:, views]
            refiner = sk.Refiner(cameras, layout="h36m17")
            steps = [refiner.step(frame[..., :2]) for frame in seen][10:]
            errors.append(
                [np.linalg.norm(s.pose - x, axis=-1) for s, x in zip(steps, truth[10:], strict=True)]
            )
            statuses.append([s.joint_status for s in steps])
    off, ok = np.array(errors) > 150, np.array(statuses) == "ok"
    return (
        f"{100 * ok.mean():.0f} % ok; of all joints {100 * np.mean(off & ok):.1f} % are ok and 150 mm off, "
        f"{100 * np.mean(off & ~ok):.1f} % weak and 150 mm off"
    )


@attack("10h", "all of four joints at one point", "4 with a finite bar")
def all_joints_at_one_point() -> str:
    cameras = rig("room", 4)
    truth = np.tile([0.0, 0.0, 1000.0], (1, 4, 1))
    result = sk.refine(None, np.moveaxis(sk.project(truth, cameras), 0, 1), cameras)
    finite = np.isfinite(result.uncertainty).all(axis=(-2, -1))
    bar = np.sqrt(np.trace(result.uncertainty[0, 0]))
    return (
        f"{int((result.joint_status == 'ok').sum())} ok, {int(finite.sum())} with a finite bar, {bar:.2g} mm"
    )


@attack("10i", "priors that confine joints to a plane, conditions of 1e9 to 1e15", "0 not positive definite")
def ill_conditioned_priors() -> str:
    cameras, truth = rig("room", 4), cmu_poses(50, 0)
    detections, rng = _detections(truth, cameras), np.random.default_rng(0)
    wrong = 0
    for exponent in (9, 11, 13, 15):
        axes = np.linalg.qr(rng.standard_normal((17, 3, 3)))[0]
        scales = 10.0 ** np.array([6.0 - exponent, 6.0, 6.0])
        prior = np.einsum("nij,j,nkj->nik", axes, scales, axes)
        prior = 0.5 * (prior + prior.swapaxes(1, 2))
        try:
            result = sk.refine(truth, detections, cameras, layout="h36m17", init_sigma=prior)
        except sk.InvalidInputError:
            continue
        bars = result.uncertainty
        known = np.isfinite(bars).all(axis=(-2, -1))
        wrong += int((~known).sum()) + int((np.linalg.eigvalsh(bars[known])[..., 0] <= 0).sum())
    return f"{wrong} of {4 * truth.shape[0] * 17} not positive definite"
