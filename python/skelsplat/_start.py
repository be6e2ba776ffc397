"""A first guess of a rig, from the joints that views share: what ``calibrate_cameras`` begins with.

Two views give their relative pose (OpenCV's MAGSAC); of a person who stays in one place it can be wrong by
any angle, though it explains the detections. Bones tell: those of a wrong pose change their lengths, and have
not the proportions of people. The joints that a good pair places give the places of the other cameras.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from operator import itemgetter

import numpy as np

from skelsplat._arrays import Array, Index
from skelsplat._optional import opencv
from skelsplat._skelsplat import Camera, Layout, project, triangulate
from skelsplat.cameras import altered

_PURPOSE = "calibrate_cameras"
# Joints that both views of a pair see: with fewer, the pair is left out.
LEAST_JOINTS = 60
# The most from which its pose is found, with so many samples at most; and those by which lags compare.
_FOUND = (3000, 1000)
COMPARED = (800, 100)
# From so many it follows on which side of both cameras they are.
_IN_FRONT = 200
# Largest distance of a joint from its epipolar line that MAGSAC considers, and from where a pair places it,
# relative to the image's longer side: depths from two views are uncertain.
_FROM_LINE = 0.004
_FROM_PLACE = 0.02
# A camera is placed by this share of the joints that it sees.
_AGREED = 0.3
# Frames by which cameras are placed, and pairs from which it begins.
_FRAMES = 150
_STARTS = 3
# Distance of the cameras of the first pair, mm.
_BASE = 3000.0
# Lags of a pair that are tried: so many maxima of the correlation, and frames on either side of the best.
_CANDIDATES = 6
_BESIDE = 2
# Bones that vary by less say no more.
_EVEN = 0.02
# Two lags of a pair are tied if one explains this part of what the other does.
_TIED = 0.95
# Cameras that count as in step are not if no lag explains less than this part of what another does.
_IN_STEP = 0.8
# Clocks that differ by fewer frames are found by adjusting cameras.
_NEAR = 15
# The least overlap of two recordings, frames; half of them at least.
_LEAST_OVERLAP = 60

Views = Iterable[tuple[int, int]]  # in pairs


@dataclass(frozen=True)
class Pair:
    """A point x of the first view is R x + t in the second, up to the scale of t."""

    views: tuple[int, int]
    R: Array
    t: Array
    lag: int  # frames that the second view's clock is ahead
    tied: bool  # another lag explains as much
    support: float  # share of the joints that it explains, times the root of their number
    uneven: float  # how much the lengths of bones differ from the body's, over time and between bones


@dataclass
class Start:
    """Cameras that were placed, by number, and their clocks, frames."""

    cameras: dict[int, Camera]
    clocks: dict[int, int]
    tied: bool = False  # whether other clocks may explain as much
    late: bool = False  # whether clocks that were not looked for explain more


def first_guess(
    detections: Array, cameras: Sequence[Camera], layout: Layout, most_lag: int, views: Views
) -> Start | None:
    """Return where cameras may be, by these pairs of views; None if no two share enough joints.

    ``detections`` are (T, M, N, 2|3), distorted pixels, NaN where missing. Lags of up to ``most_lag`` frames
    are tried where the motion of the joints looks alike, and the one is taken with which the epipolar
    geometry explains most.
    """
    recording = _Recording(detections[..., :2], cameras, rays_of(detections, cameras), layout)
    pairs = list(recording.pairs(most_lag, views))
    best = sorted(pairs, key=lambda pair: -pair.support / pair.uneven)[:_STARTS]
    grown = [recording.grown(pair, pairs) for pair in best]
    start = min(grown, key=recording.misses, default=None)
    if start is not None and not most_lag:
        start.late = recording.is_out_of_step(start, pairs)
    return start


def from_line(*cameras: Camera) -> float:
    """Return the largest distance of a joint from its epipolar line between views of these cameras."""
    return _FROM_LINE * min(map(_reach, cameras))


def off_lines(x: Array, y: Array, R: Array, t: Array) -> Array:
    """Return squared distances (…) from epipolar lines, to first order, of joints x and y (…, 2) on rays.

    A point p of the first view is R p + t in the second, of which t has any length.
    """
    essential = np.cross(t, R.T).T
    x, y = (np.concatenate([one, np.ones((*one.shape[:-1], 1))], axis=-1) for one in (x, y))
    line, other = x @ essential.T, y @ essential
    slopes = np.square(line[..., :2]).sum(axis=-1) + np.square(other[..., :2]).sum(axis=-1)
    squares: Array = np.square((y * line).sum(axis=-1)) / slopes
    return squares


def _reach(camera: Camera) -> float:
    """Return the longer side of a camera's image at distance 1."""
    return float(max(camera.size) / np.asarray(camera.K)[0, 0])


def rays_of(detections: Array, cameras: Sequence[Camera]) -> Array:
    """Return where the rays of detections meet the plane at distance 1, (T, M, N, 2)."""
    out = np.full((*detections.shape[:3], 2), np.nan)
    for i, camera in enumerate(cameras):
        ideal = camera.undistort(detections[:, i, :, :2].reshape(-1, 2))
        K = np.asarray(camera.K)
        out[:, i] = ((ideal - K[:2, 2]) / np.diag(K)[:2]).reshape(out[:, i].shape)
    return out


def placed_by(points: Array, rays: Array, camera: Camera) -> tuple[Camera, int] | None:
    """Return a camera placed by points (…, 3) on its rays (…, 2), and how many agree; None if too few do."""
    flat, rays = points.reshape(-1, 3), rays.reshape(-1, 2)
    both = np.isfinite(rays).all(axis=1) & np.isfinite(flat).all(axis=1)
    if both.sum() < LEAST_JOINTS:
        return None
    cv2, farthest = opencv(_PURPOSE), _FROM_PLACE * _reach(camera)
    options = {"reprojectionError": farthest, "iterationsCount": 300, "flags": cv2.SOLVEPNP_SQPNP}
    cv2.setRNGSeed(0)
    ok, turn, t, agreed = cv2.solvePnPRansac(flat[both], rays[both], np.eye(3), None, **options)
    if not ok or len(agreed) < max(LEAST_JOINTS // 2, _AGREED * both.sum()):
        return None
    return altered(camera, R=cv2.Rodrigues(turn)[0], t=t.ravel()), len(agreed)


def _shared(a: Array, b: Array, lag: int) -> tuple[Array, Array]:
    """Return the joints that both views see at the same time, (K, 2) each."""
    steps = len(a)
    first = a[max(0, -lag) : steps - max(0, lag)].reshape(-1, 2)
    second = b[max(0, lag) : steps + min(0, lag)].reshape(-1, 2)
    both = np.isfinite(first).all(axis=1) & np.isfinite(second).all(axis=1)
    return first[both], second[both]


def relative(
    a: Array, b: Array, lag: int, farthest: float, most: tuple[int, int]
) -> tuple[Array, Array, float] | None:
    """Return R, t and the support of a pair; None with too few joints, or without a solution."""
    first, second = _shared(a, b, lag)
    if len(first) < LEAST_JOINTS:
        return None
    joints, samples = most
    if len(first) > joints:
        chosen = np.random.default_rng(len(first)).choice(len(first), joints, replace=False)
        first, second = first[chosen], second[chosen]
    cv2, unit = opencv(_PURPOSE), np.eye(3)
    options = {"method": cv2.USAC_MAGSAC, "prob": 0.9999, "threshold": farthest, "maxIters": samples}
    essential, inliers = cv2.findEssentialMat(first, second, unit, **options)
    if essential is None or essential.shape != (3, 3) or not inliers.any():
        return None
    agreed = np.flatnonzero(inliers)
    some = agreed[:: max(1, len(agreed) // _IN_FRONT)]
    count, R, t, _ = cv2.recoverPose(essential, first[some], second[some], unit)
    return R, t.ravel(), float(count / len(some) * len(agreed) / np.sqrt(len(first)))


def speeds_of(rays: Array) -> Array:
    """Return how fast each joint of a view moves, relative to its mean, (T, N); 0 where unknown."""
    step = np.linalg.norm(rays[2:] - rays[:-2], axis=-1)
    step = np.concatenate([step[:1], step, step[-1:]])
    known = np.isfinite(step)
    scale = np.nanmedian(np.where(known, step, np.nan)) if known.any() else 1.0
    slow = np.log1p(np.where(known, step, 0.0) / max(scale, 1e-12))
    mean = np.where(known, slow, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    speeds: Array = np.where(known, slow - mean, 0.0)
    return speeds


def lags_of(a: Array, b: Array, most: int) -> Index:
    """Return the lags at which the motion in two views looks most alike, 0 among them."""
    steps = len(a)
    most = min(most, steps - max(_LEAST_OVERLAP, steps // 2))
    if most < 1:
        return np.zeros(1, dtype=np.int64)
    size = 2 * steps
    product = np.conj(np.fft.rfft(a, size, axis=0)) * np.fft.rfft(b, size, axis=0)
    alike = np.fft.irfft(product.sum(axis=1), size)
    lags = np.arange(-most, most + 1)
    alike = alike[lags % size] / np.sqrt(steps - np.abs(lags))
    inner = alike[1:-1]
    peaks = np.flatnonzero((inner >= alike[:-2]) & (inner >= alike[2:])) + 1
    best = peaks[np.argsort(-alike[peaks], kind="stable")[:_CANDIDATES]]
    return np.unique(np.append(lags[best], 0))


@dataclass(frozen=True)
class _Recording:
    """What all steps look at: detections, blank cameras, rays (T, M, N, 2) of the detections, bones."""

    pixels: Array
    cameras: Sequence[Camera]
    rays: Array
    layout: Layout

    def pairs(self, most_lag: int, views: Views) -> Iterator[Pair]:
        """Yield every pair of views that share enough joints."""
        moves = [speeds_of(one) for one in self.rays.swapaxes(0, 1)] if most_lag else []
        for a, b in views:
            farthest = from_line(self.cameras[a], self.cameras[b])
            first, second, lag, tied = self.rays[:, a], self.rays[:, b], 0, False
            if most_lag:
                lag, tied = _best_lag(first, second, lags_of(moves[a], moves[b], most_lag), farthest)
            if (found := relative(first, second, lag, farthest, _FOUND)) is not None:
                R, t, support = found
                start = Start({a: self.cameras[a], b: self.placed(b, R, _BASE * t)}, {a: 0, b: lag})
                points = self.points(start, self.frames(start))
                yield Pair((a, b), R, t, lag, tied, support, _unevenness(points, self.layout))

    def placed(self, view: int, R: Array, t: Array) -> Camera:
        """Return the camera of a view at a place."""
        return altered(self.cameras[view], R=R, t=t)

    def frames(self, start: Start) -> Index:
        """Return frames of the first camera in which two or more see somebody."""
        counts = np.arange(len(self.rays))
        seen = np.zeros(len(counts), dtype=np.int64)
        for i in start.cameras:
            seen += np.isfinite(self.at(self.rays, i, counts, start)).any(axis=(1, 2))
        shared: Index = counts[seen >= 2]
        some: Index = shared[np.linspace(0, len(shared) - 1, min(len(shared), _FRAMES)).astype(int)]
        return some

    def at(self, values: Array, view: int, frames: Index, start: Start) -> Array:
        """Return a view's values (T, M, N, 2) at the first camera's frames, (K, N, 2); NaN outside."""
        own = frames + start.clocks[view]
        there = (own >= 0) & (own < len(values))
        out = np.full((len(frames), *values.shape[2:]), np.nan)
        out[there] = values[own[there], view]
        return out

    def points(self, start: Start, frames: Index) -> Array:
        """Return the joints (K, N, 3) that the placed cameras show."""
        seen = np.stack([self.at(self.pixels, i, frames, start) for i in start.cameras], axis=1)
        return triangulate(seen, list(start.cameras.values()))

    def grown(self, pair: Pair, pairs: Sequence[Pair]) -> Start:
        """Return the rig that a pair begins, with every camera that its joints place."""
        a, b = pair.views
        start = Start({a: self.cameras[a], b: self.placed(b, pair.R, _BASE * pair.t)}, {a: 0, b: pair.lag})
        left = [i for i in range(len(self.cameras)) if i not in pair.views]
        while left:
            frames = self.frames(start)
            points = self.points(start, frames)
            found = [(i, self.resected(start, i, frames, points, pairs)) for i in left]
            there = [(i, one) for i, one in found if one is not None]
            if not there:
                break
            i, (camera, clock, _) = max(there, key=lambda item: item[1][2])
            start.cameras[i], start.clocks[i] = camera, clock
            left.remove(i)
        # periodic motion: one pair that shows it is enough, if it explains something at all
        least = 0.5 * max(one.support for one in pairs)
        related = (one for one in pairs if set(one.views) <= start.cameras.keys() and one.support > least)
        start.tied = any(one.tied for one in related)
        return start

    def resected(
        self, start: Start, view: int, frames: Index, points: Array, pairs: Sequence[Pair]
    ) -> tuple[Camera, int, int] | None:
        """Return a camera, its clock, and how many joints agree; None if too few place it."""
        known = [pair for pair in pairs if view in pair.views and (set(pair.views) & start.cameras.keys())]
        if not known:
            return None
        best = max(known, key=lambda pair: (not pair.tied, pair.support))
        a, b = best.views
        clock = start.clocks[a] + best.lag if b == view else start.clocks[b] - best.lag
        rays = self.at(self.rays, view, frames, Start({}, {view: clock}))
        found = placed_by(points, rays, self.cameras[view])
        return found and (found[0], clock, found[1])

    def is_out_of_step(self, start: Start, pairs: Sequence[Pair]) -> bool:
        """Tell whether some placed camera shows the same motion clearly earlier or later."""
        there = [pair for pair in pairs if set(pair.views) <= start.cameras.keys()]
        chosen = {
            max((one for one in there if i in one.views), key=lambda one: one.support).views
            for i in start.cameras
        }
        for a, b in chosen:
            first, second = self.rays[:, a], self.rays[:, b]
            farthest = from_line(self.cameras[a], self.cameras[b])
            lags = lags_of(speeds_of(first), speeds_of(second), len(first))
            lag, _ = _best_lag(first, second, lags, farthest)
            now, then = (relative(first, second, one, farthest, COMPARED) for one in (0, lag))
            if now and then and abs(lag) > _NEAR and now[2] < _IN_STEP * then[2]:
                return True
        return False

    def misses(self, start: Start) -> tuple[int, float]:
        """Return how badly a rig explains the detections: cameras it does not place, median distance, px."""
        frames = self.frames(start)
        points = self.points(start, frames)
        seen = np.stack([self.at(self.pixels, i, frames, start) for i in start.cameras], axis=1)
        off = np.moveaxis(project(points, list(start.cameras.values())), 0, 1) - seen
        return len(self.cameras) - len(start.cameras), float(np.nanmedian(np.linalg.norm(off, axis=-1)))


def _unevenness(points: Array, layout: Layout) -> float:
    """Return by how much, as a share, the lengths of bones vary: the median over bones."""
    lengths = [np.linalg.norm(points[:, a] - points[:, b], axis=1) for a, b in layout.limbs]
    logs = [np.log(length[np.isfinite(length) & (length > 0)]) for length in lengths]
    spread = [float(np.median(np.abs(log - np.median(log)))) for log in logs if len(log) > 2]
    return max(float(np.median(spread)), _EVEN) if spread else 1.0


def _best_lag(a: Array, b: Array, lags: Index, farthest: float) -> tuple[int, bool]:
    """Return the lag at which the epipolar geometry explains most, and whether another explains as much."""

    def support(lag: int) -> float:
        found = relative(a, b, lag, farthest, COMPARED)
        return -1.0 if found is None else found[2]

    def around(lag: int) -> tuple[int, float]:
        some = range(lag - _BESIDE, lag + _BESIDE + 1)
        return max(((one, support(one)) for one in some), key=itemgetter(1))

    rough = {int(lag): support(int(lag)) for lag in lags}
    ranked = sorted(rough, key=rough.__getitem__, reverse=True)
    rival = next((lag for lag in ranked if abs(lag - ranked[0]) > 2 * _BESIDE), None)
    best, most = around(ranked[0])
    if rival is None:
        return best, False
    other, as_much = around(rival)
    tied = min(most, as_much) > _TIED * max(most, as_much)
    return (best if most >= as_much else other), tied
