"""Poses, rigs and detections for measuring accuracy; all are determined by the seed.

Poses are frames of the CMU motion capture if it is in ``../shared/data``, otherwise
the package's synthetic motions. Their detections are simulated. ``mvor`` gives real detections, assigned to
people by the ground truth (oracle association).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import skelsplat as sk
from skelsplat import synthetic
from skelsplat.datasets import Take
from skelsplat.evaluation import methods
from skelsplat.synthetic import DetectionNoise

FloatArray = NDArray[np.float64]

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
CMU = DATA / "cmu_mocap" / "cmu_s01_to_s12_10hz.npz"
CMU_30HZ = DATA / "cmu_mocap" / "cmu_s01_to_s12_30hz.npz"
MVOR = DATA / "mvor" / "mvor_days12.npz"
POSES = "CMU motion capture" if CMU.is_file() else "synthetic motions (no CMU motion capture here)"

NOISES = {
    "good": DetectionNoise.good(),
    "noisy": DetectionNoise.noisy(),
    "occluded 2": DetectionNoise.occluded(2),
    "occluded 3": DetectionNoise.occluded(3),
    "occluded 3 hard": DetectionNoise.occluded(3, hard=True),
}

# Human3.6M-17 from CMU's 19 joints; the nose, missing in the capture, is placed close to the head.
_CMU_JOINTS = [
    "pelvis", "r_hip", "r_knee", "r_ankle", "l_hip", "l_knee", "l_ankle", "abdomen", "neck", "head", "head",
    "l_shoulder", "l_elbow", "l_wrist", "r_shoulder", "r_elbow", "r_wrist",
]  # fmt: skip
_NOSE = 9
_NOSE_OFFSET_MM = (60.0, 0.0, -20.0)
_SCATTER_MM = 500.0
_BOX_MARGIN = 1.1  # a body extends beyond its joints
# Distance of the human36m_like cameras from the centre of the room.
_ROOM_RADIUS_MM = 5300.0


@dataclass(frozen=True)
class Scene:
    """The input of a method, and the ground truth, in the rig's unit, mm."""

    truth: FloatArray  # (T, N, 3); NaN where there is none
    detections: FloatArray  # (T, M, N, 3): pixels and confidence; missing = NaN or confidence 0
    rig: sk.CameraRig
    layout: str
    source: str

    @property
    def detected(self) -> NDArray[np.bool_]:
        """Whether each joint has a usable detection, (T, M, N)."""
        return np.isfinite(self.detections).all(axis=-1) & (self.detections[..., 2] > 0)

    @property
    def judged(self) -> FloatArray:
        """Truth (T, N, 3), NaN where fewer than two views detect the joint; the same for all methods."""
        return np.where((self.detected.sum(axis=1) >= 2)[..., None], self.truth, np.nan)

    def solved(self, method: str) -> FloatArray:
        """Return the poses of a method of `skelsplat evaluate`; crops are those of the detected joints."""
        pixels = np.where(self.detected[..., None], self.detections[..., :2], np.nan)
        extent = np.fmax.reduce(pixels, axis=2) - np.fmin.reduce(pixels, axis=2)
        boxes = np.concatenate([np.zeros(extent.shape), _BOX_MARGIN * extent], axis=-1)
        frames = np.arange(len(self.truth))
        take = Take("", "", "", self.rig, frames, self.truth, self.detections, boxes=boxes)
        chosen, options = methods.get(method), methods.Options(n_threads=1)
        return chosen.solve(take, sk.layouts.get(self.layout), chosen.settings(options)).pose

    def dlt(self) -> FloatArray:
        """Return the DLT of all pixels that there are, whatever the confidences."""
        there = np.where(self.detections[..., 2:] > 0, self.detections[..., :2], np.nan)
        return sk.triangulate(there, self.rig, method="dlt")

    def refined(
        self,
        start: FloatArray | None = None,
        config: sk.RefineConfig | None = None,
        *,
        init_sigma: float | FloatArray | None = None,
    ) -> sk.Refinement:
        """Refine with ``RefineConfig()`` or another configuration."""
        given = {"layout": self.layout, "init_sigma": init_sigma, "config": config}
        return sk.refine(start, self.detections, self.rig, **given)

    def mpjpe(self, pose: FloatArray) -> float:
        """MPJPE in mm over the joints that at least two views detect."""
        return float(sk.metrics.mpjpe(pose, self.judged))


def covered(
    pose: FloatArray, covariance: FloatArray, truth: FloatArray, name: str = ""
) -> dict[str, float | None]:
    """Share of joints within 1, 2 and 3 standard deviations, %; ideal are 19.9, 73.9 and 97.1."""
    heads = [f"{name}{k} σ" for k in (1, 2, 3)]
    known = np.isfinite(truth - pose).all(axis=-1) & np.isfinite(covariance).all(axis=(-2, -1))
    if not known.any():
        return dict.fromkeys(heads)
    shares = 100 * np.asarray(sk.metrics.sigma_coverage(pose, covariance, truth))
    return dict(zip(heads, shares.tolist(), strict=True))


def missing(found: Mapping[str, FloatArray], scene: Scene, where: str) -> list[str]:
    """Note for each method the share of judged joints without a position, if any."""
    shares = {name: float(sk.metrics.missing_rate(pose, scene.judged)) for name, pose in found.items()}
    return [
        f"{where}: {name} leaves {100 * s:.2f} % of the joints out" for name, s in shares.items() if s > 0
    ]


@cache
def cmu_takes(path: Path = CMU) -> dict[str, FloatArray]:
    """All takes by name, each (F, 17, 3) mm; `CMU` has 10 frames per second, `CMU_30HZ` 30."""
    with np.load(path) as archive:
        order = [list(archive["joint_names"]).index(name) for name in _CMU_JOINTS]
        takes = {
            name: 1000.0 * archive[name][:, order].astype(np.float64)
            for name in archive.files
            if name != "joint_names"
        }
    for take in takes.values():
        take[:, _NOSE] += _NOSE_OFFSET_MM
    return takes


def cmu_poses(n: int, seed: int) -> FloatArray:
    """Return (n, 17, 3) mm: frames of all takes in turn, with random heading, in the centre of the room.

    The pelvis is within ±0.5 m of the centre on both axes. Without the data: ``synthetic.motion``.
    """
    rng = np.random.default_rng(seed)
    if CMU.is_file():
        takes = list(cmu_takes().values())
        order = np.resize(rng.permutation(len(takes)), n)
        poses = np.stack([takes[k][rng.integers(len(takes[k]))] for k in order])
    else:
        poses = _synthetic_poses(n, seed)[rng.permutation(n)]
    poses = poses - poses[:, :1] * [1.0, 1.0, 0.0]
    angle = rng.uniform(0.0, 2 * np.pi, size=(n, 1))
    x, y = poses[..., 0], poses[..., 1]
    cos, sin = np.cos(angle), np.sin(angle)
    poses = np.stack([cos * x - sin * y, sin * x + cos * y, poses[..., 2]], axis=-1)
    poses[..., :2] += rng.uniform(-_SCATTER_MM, _SCATTER_MM, size=(n, 1, 2))
    return poses


def _synthetic_poses(n: int, seed: int) -> FloatArray:
    """Every fourth frame of all motions, (n, 17, 3) mm."""
    each = -(-n // len(synthetic.motion_names))
    takes = [
        synthetic.motion(name, 4 * each, seed=seed + k)[::4] for k, name in enumerate(synthetic.motion_names)
    ]
    return np.concatenate(takes)[:n]


def simulated(poses: int, *, noise: str = "good", seed: int = 0) -> Scene:
    """Simulate the six motions in equal shares, seen by Human3.6M-like cameras."""
    cameras, truth = synthetic.human36m_like(), _synthetic_poses(poses, seed)
    seen = synthetic.simulate_detections(truth, cameras, noise=NOISES[noise], layout="h36m17", seed=seed)
    return Scene(truth, seen, cameras, "h36m17", "synthetic motions, simulated detections")


def rig(n_views: int) -> sk.CameraRig:
    """Return the cameras of a room, beyond four those and more on a dome of the same distance."""
    more = synthetic.dome(n_views - 4, radius_mm=_ROOM_RADIUS_MM) if n_views > 4 else ()
    return sk.CameraRig([*list(synthetic.human36m_like())[:n_views], *more], unit="mm")


def scene(noise: str | DetectionNoise, poses: int, seed: int, *, n_views: int = 4, n_seeds: int = 1) -> Scene:
    """Simulate detections of `poses` poses in total, drawn with the seeds `seed`, `seed` + 1, …."""
    cameras, model = rig(n_views), NOISES[noise] if isinstance(noise, str) else noise
    truths = [cmu_poses(-(-poses // n_seeds), seed + k) for k in range(n_seeds)]
    detections = [
        synthetic.simulate_detections(truth, cameras, noise=model, layout="h36m17", seed=seed + k)
        for k, truth in enumerate(truths)
    ]
    source = f"{POSES}, room rig, simulated detections"
    return Scene(np.concatenate(truths), np.concatenate(detections), cameras, "h36m17", source)


@dataclass(frozen=True)
class Stills:
    """MVOR frame by frame: F frames of 3 views with up to P detections, and up to 7 labelled people."""

    people: FloatArray  # (F, 3, P, 17, 3)
    truth: FloatArray  # (F, 7, 17, 3) mm, NaN where not labelled
    match: NDArray[np.int64]  # (F, 7, 3): the detection of each labelled person (oracle association), or −1
    boxes: FloatArray  # (F, 3, 7, 4) px: left, top, right, bottom; also of people without a truth
    cameras: sk.CameraRig

    def seen(self) -> tuple[NDArray[np.int64], NDArray[np.int64], FloatArray]:
        """Return frame, place and detections (K, 3, 17, 3) of labelled people whom two views detect."""
        frame, person = np.nonzero((self.match >= 0).sum(axis=-1) >= 2)
        chosen = self.match[frame, person]
        detections = self.people[frame[:, None], np.arange(3), np.maximum(chosen, 0)]
        detections[chosen < 0] = np.nan
        return frame, person, detections


def mvor_stills(detector: str) -> Stills:
    """Read MVOR, days 1 and 2."""
    if not MVOR.is_file():
        raise FileNotFoundError(f"the operating-room data are not at {MVOR}")
    with np.load(MVOR) as archive:
        size = tuple(int(s) for s in archive["image_size"])
        matrices = list(zip(archive["K"], archive["w2c"], strict=True))
        match, people = archive[f"gt_match_{detector}"], archive[f"det2d_{detector}"].astype(np.float64)
        labels, names = archive["gt3d"].astype(np.float64), [str(n) for n in archive["gt_joint_names"]]
        boxes = archive["bbox"].astype(np.float64)
    cameras = sk.CameraRig([sk.Camera(K, w2c[:, :3], w2c[:, 3], size=size) for K, w2c in matrices], unit="mm")
    people[..., 2] = np.clip(people[..., 2], 0.0, 1.0)
    truth = np.full((*labels.shape[:2], 17, 3), np.nan)
    for j, name in enumerate(names):
        if name in sk.layouts.COCO17.joints:
            truth[:, :, sk.layouts.COCO17.joints.index(name)] = labels[:, :, j, :3]
    truth[(truth == 0.0).all(axis=-1)] = np.nan
    boxes[..., 2:] += boxes[..., :2]
    return Stills(people, truth, match.astype(np.int64), boxes, cameras)


def mvor() -> Scene:
    """MVOR, an operating room: every labelled person detected in at least two views, real detections.

    The association is oracle. The truth has the eight joints that COCO-17 and the labels share (shoulders,
    elbows, wrists, hips), labelled to about ±50 mm. The published distortion is not applied: it makes the
    labels' reprojection error larger.
    """
    stills = mvor_stills("openpose")
    frame, person, detections = stills.seen()
    source = "MVOR, OpenPose, real detections, oracle association"
    return Scene(stills.truth[frame, person], detections, stills.cameras, "coco17", source)
