"""What could be wrong with one camera, tried out: the change that makes all cameras agree is the cause.

Every hypothesis changes the scene: another frame count, left and right swapped, detections of another image,
a turned camera, a moved one. It is judged by leave-one-out reprojection of *all* cameras, because a camera
that is wrong spoils what the others are compared with, too.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array, Index, median, medians
from skelsplat._words import capitalised, percent, px
from skelsplat.cameras import altered, matrix_from_vector
from skelsplat.findings import Finding, Subject
from skelsplat.layouts import mirror_images
from skelsplat.rig_check._scene import POOR, Scene
from skelsplat.rig_check._whole import CHANGES, resizer

# A cause makes cameras agree better by so much, over all and for itself, and by more than detectors' noise.
_ALL_BETTER = 0.85
_ITSELF_BETTER = 0.7
_LEAST_PX = 1.0
_HALF_BETTER = 0.9  # what is wrong is wrong in both halves of a recording
_TWO_BETTER = 0.4  # two cameras agree better by chance more easily
_AS_GOOD = 1.1  # of two causes that explain as much the simpler one is named
_MOST_SHIFT = 30  # frames by which a camera's count is tried to be off
_PART = 3  # of the recording is the most that is tried
_LEAST_SPAN = 12
_MUCH_BETTER = 0.35  # what is left with sides swapped back, next to another fault: nothing was fitted
_NEARLY_AS_GOOD = 1.2  # what explains nearly as much is named with it
_FEW = 12  # what fewer frames show may be chance
_MIRRORED_SHARE = 1 / 4  # of a camera's frames with left and right swapped
ONCE = " once the above is corrected"
_ROUNDS = 30  # steps of a resection
_LEAST = 20  # points for one
_ORDER = ("frame_offset", "sides_swapped", "images", "size", "rotated", "moved")  # the simplest kind first


@dataclass(frozen=True)
class Cause:
    """A hypothesis about one camera, the scene in which it is corrected, and what the correction changes."""

    kind: str  # one of `_ORDER`
    view: int
    scene: Scene
    change: dict[str, Any]


def explain(
    scene: Scene, earlier: Sequence[Finding] = (), layout: sk.Layout | None = None
) -> tuple[list[Finding], Scene]:
    """Name causes one by one, and return the scene with all corrected, as `earlier` ones are in it."""
    pairs = () if layout is None else layout.left_right
    mirror = mirror_images(layout.n_joints, pairs) if layout is not None and pairs else None
    findings: list[Finding] = []
    for _ in range(len(scene.cameras)):
        if not np.isfinite(scene.disagreement):
            break
        causes = [cause for cause in _causes(scene, mirror) if _explains(scene, cause)]
        if not causes:
            break
        cause = _simplest_of_the_best(causes)
        findings.append(_finding(scene, cause, [*earlier, *findings], _rivals(cause, causes)))
        scene = cause.scene
    return findings, scene


def _finding(scene: Scene, cause: Cause, earlier: Sequence[Finding], rivals: Sequence[Cause]) -> Finding:
    """Return the finding of a cause in a scene in which `earlier` ones are corrected."""
    name, subject = scene.names[cause.view], Subject((scene.names[cause.view],))
    numbers: dict[str, Any] = {
        **cause.change,
        "before_px": float(scene.left_out[cause.view]),
        "after_px": float(cause.scene.left_out[cause.view]),
        "mean_px": cause.scene.disagreement,
    }
    if rivals:
        numbers["rivals"] = [
            one.change
            | {"camera": scene.names[one.view], "kind": one.kind, "mean_px": one.scene.disagreement}
            for one in rivals
        ]
    if len(scene.judged) < _FEW:
        numbers["few_frames"] = len(scene.judged)
    better = f"error {px(numbers['before_px'])}{ONCE if earlier else ''}, {px(numbers['after_px'])} after "
    better += "the correction"
    also = _rivalled(numbers)
    if cause.kind == "frame_offset":
        frames = numbers["frames"]
        sentence = f"{name}'s frame numbers are {abs(frames)} too {'high' if frames > 0 else 'low'}: its "
        sentence += f"frame f{frames:+d} is frame f of the others ({better}).{also}"
        return Finding("frame_offset", "error", subject, numbers, sentence=sentence)
    if cause.kind == "sides_swapped":
        sentence = f"{name}: left and right are swapped in {percent(numbers['share_of_frames'])} of its "
        sentence += f"frames ({better}). Were its images mirrored for the detector, or its joints named from "
        sentence += f"the viewer's side?{also}"
        return Finding("sides_swapped", "error", subject, numbers, sentence=sentence)
    if "images" in numbers:
        sentence = f"{name}'s images are {numbers['images']} ({better}).{also}"
        return Finding("images_changed", "error", subject, numbers, sentence=sentence)
    sentence = f"{name}'s calibration looks wrong: {_motion(numbers, 'the camera')} restores agreement "
    sentence += f"({better}). The camera was moved after calibration, its images were cropped, or the "
    sentence += f"calibration belongs to another camera.{also}"
    return Finding("camera_moved", "error", subject, numbers, sentence=sentence)


def _rivalled(numbers: Mapping[str, Any]) -> str:
    """Return sentences on other explanations, and on how few frames support it."""
    text, rivals = "", numbers.get("rivals", ())
    if rivals:
        ways = capitalised(" or ".join(map(_briefly, rivals)))
        means = " or ".join(f"{rival['mean_px']:.1f}" for rival in rivals)
        text = f" {ways} explains it almost as well (mean error {means} px instead of "
        text += f"{numbers['mean_px']:.1f} px)."
    if "few_frames" in numbers:
        text += f" Based on few frames ({numbers['few_frames']}); provide more."
    return text


def _briefly(numbers: Mapping[str, Any]) -> str:
    """Return what would be changed about one camera."""
    name = numbers["camera"]
    if "frames" in numbers:
        return f"changing {name}'s frame numbers by {-numbers['frames']:+d}"
    if "images" in numbers:
        return f"treating {name}'s images as {numbers['images']}"
    if "share_of_frames" in numbers:
        return f"swapping left and right in {name}"
    return _motion(numbers, name)


def _motion(numbers: Mapping[str, Any], what: str) -> str:
    moved = f" and moving it by {numbers['mm']:.0f} mm" if numbers["mm"] else ""
    return f"rotating {what} by {numbers['degrees']:.1f}°{moved}"


def _simplest_of_the_best(causes: Sequence[Cause]) -> Cause:
    least = min(cause.scene.disagreement for cause in causes)
    good = [cause for cause in causes if cause.scene.disagreement <= _AS_GOOD * least]
    return min(good, key=lambda cause: (_ORDER.index(cause.kind), cause.scene.disagreement))


def _rivals(chosen: Cause, causes: Sequence[Cause]) -> list[Cause]:
    """Return what explains nearly as much: of each other camera, and of the same time against place."""
    limit = _NEARLY_AS_GOOD * chosen.scene.disagreement
    by_view: dict[int, list[Cause]] = {}
    for cause in causes:
        other = cause.view != chosen.view or (cause.kind == "frame_offset") != (chosen.kind == "frame_offset")
        if other and cause.scene.disagreement <= limit:
            by_view.setdefault(cause.view, []).append(cause)
    rivals = [_simplest_of_the_best(some) for some in by_view.values()]
    return sorted(rivals, key=lambda cause: cause.scene.disagreement)


def _explains(scene: Scene, cause: Cause) -> bool:
    view, frames = cause.view, len(scene.judged)
    old, new = scene.residuals(view), cause.scene.residuals(view)
    before, after = scene.left_out[view], median(new)
    after *= max(1.0, 1.0 / cause.change.get("factor", 1.0))  # smaller images make smaller errors
    better = _ALL_BETTER if len(scene.cameras) > 2 else _TWO_BETTER
    good = POOR * np.hypot(*scene.cameras[view].size)
    if cause.kind == "sides_swapped":
        good = max(good, _MUCH_BETTER * before)
    halves = (slice(0, (frames + 1) // 2), slice((frames + 1) // 2, frames))
    return bool(
        after <= _ITSELF_BETTER * before
        and before - after >= _LEAST_PX
        and after <= good
        # NaN, a half in which the camera sees nothing, does not count
        and all(not median(new[half]) > _HALF_BETTER * median(old[half]) for half in halves)
        and cause.scene.disagreement <= better * scene.disagreement  # last, as it takes longest
    )


def _causes(scene: Scene, mirror: Index | None) -> Iterator[Cause]:
    """Yield every hypothesis; `mirror` (N,) is the joint on the other side of the body, if that is known."""
    if len(scene.cameras) == 2:
        yield from _between_two(scene, mirror)
        return
    for view in range(len(scene.cameras)):
        points, old = scene.points_without(view), scene.cameras[view]
        shift = _best_shift(scene, view, points)
        if shift != scene.shifts[view]:
            frames = {"frames": shift - scene.shifts[view]}
            yield Cause("frame_offset", view, scene.changed(view, shift=shift), frames)
        if mirror is not None:
            yield from _swapped(scene, view, points, mirror)
        yield from _of_images(scene, view, points, mirror)
        for kind, move in (("rotated", False), ("moved", True)):
            camera = _resect(scene, view, points, move=move)
            if camera is not None:
                distance = float(np.linalg.norm(np.asarray(old.centre) - np.asarray(camera.centre)))
                cosine = (np.trace(np.asarray(old.R).T @ np.asarray(camera.R)) - 1.0) / 2.0
                degrees = float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))
                change = {"degrees": degrees, "mm": distance if move else 0.0}
                yield Cause(kind, view, scene.changed(view, camera=camera), change)


def _of_images(scene: Scene, view: int, points: Array, mirror: Index | None) -> Iterator[Cause]:
    """Yield images other than the calibration's: of another size, turned or mirrored."""
    seen, size = scene.detections[:, view], scene.cameras[view].size
    factor = _size_factor(scene, view, points)
    if factor is not None:
        words = f"of another size (detections fit if multiplied by {factor:.3g})"
        resized = scene.changed(view, seen=resizer(factor)(seen, size))
        yield Cause("size", view, resized, {"images": words, "factor": factor})
    for words, undo in CHANGES.items():
        yield Cause("images", view, scene.changed(view, seen=undo(seen, size)), {"images": words})
    if mirror is not None:  # the detector takes the left hand of a mirrored person for the right one
        upright = scene.changed(view, seen=CHANGES["mirrored"](seen[:, mirror], size))
        yield Cause("images", view, upright, {"images": "mirrored"})


def _swapped(scene: Scene, view: int, points: Array, mirror: Index) -> Iterator[Cause]:
    """Left and right swapped in the frames in which the camera fits the points better that way."""
    sides, seen = mirror != np.arange(len(mirror)), scene.detections[:, view]
    exchanged = scene.changed(view, seen=seen[:, mirror])
    as_given, otherwise = (medians(one.distances(view, points)[:, sides]) for one in (scene, exchanged))
    known = np.isfinite(as_given) & np.isfinite(otherwise)
    share = float((otherwise < as_given)[known].mean()) if known.any() else 0.0
    if share < _MIRRORED_SHARE:
        return
    # frames that are not judged are like the nearest one that is
    judged = scene.frames[scene.judged][known] + scene.shifts[view]
    middle = (judged[1:] + judged[:-1]) / 2
    swapped = (otherwise < as_given)[known][np.searchsorted(middle, scene.frames)]
    found = np.where(swapped[:, None, None], seen[:, mirror], seen)
    yield Cause("sides_swapped", view, scene.changed(view, seen=found), {"share_of_frames": share})


def _between_two(scene: Scene, mirror: Index | None) -> Iterator[Cause]:
    """Another frame count of the second of two cameras, or sides swapped in either; two tell nothing else."""
    tried = (scene.changed(1, shift=shift) for shift in _shifts(scene, 1))
    best = min(tried, key=lambda other: other.disagreement, default=scene)
    if best.shifts != scene.shifts:
        yield Cause("frame_offset", 1, best, {"frames": best.shifts[1] - scene.shifts[1]})
    for view in range(2) if mirror is not None else ():
        swapped = scene.changed(view, seen=scene.detections[:, view, mirror])
        yield Cause("sides_swapped", view, swapped, {"share_of_frames": 1.0})


def _shifts(scene: Scene, view: int) -> list[int]:
    """Frame counts to try, the camera's own first."""
    span = int(scene.frames[-1] - scene.frames[0])
    own, most = scene.shifts[view], min(_MOST_SHIFT, span // _PART) if span >= _LEAST_SPAN else 0
    return sorted(range(own - most, own + most + 1), key=lambda shift: (abs(shift - own), shift))


def _best_shift(scene: Scene, view: int, points: Array) -> int:
    """Return the shift of a camera's frames at which its detections fit the points best."""
    given = scene.distances(view, points)
    enough = 0.5 * np.isfinite(given).sum()
    best, least = scene.shifts[view], median(given)
    for shift in _shifts(scene, view):
        distances = scene.distances(view, points, shift)
        known = distances[np.isfinite(distances)]
        if known.size >= max(enough, 1) and np.median(known) < least:
            best, least = shift, float(np.median(known))
    return best


def _size_factor(scene: Scene, view: int, points: Array) -> float | None:
    """Factor on a camera's detections that would put them on the points' projections; None if near 1."""
    pixels = np.asarray(sk.project(points, [scene.cameras[view]]))[0] + 0.5
    seen = scene.seen(view) + 0.5
    known = np.isfinite(pixels).all(axis=-1) & np.isfinite(seen).all(axis=-1)
    lengths = np.linalg.norm(seen[known], axis=-1)
    if lengths.size == 0 or not lengths.min() > 0:
        return None
    factor = float(np.median((pixels[known] * seen[known]).sum(axis=-1) / lengths**2))
    return factor if factor > 0 and abs(np.log(factor)) > 0.05 else None


def _resect(scene: Scene, view: int, points: Array, *, move: bool) -> sk.Camera | None:
    """Return the camera turned, with `move` also moved, to fit points (J, N, 3) mm; None for too few."""
    camera, seen = scene.cameras[view], scene.seen(view)
    known = np.isfinite(seen).all(axis=-1) & np.isfinite(points).all(axis=-1)
    world, pixels = points[known], np.asarray(camera.undistort(seen[known]))
    inside = np.isfinite(pixels).all(axis=-1)
    world, pixels = world[inside], pixels[inside]
    R, t = np.asarray(camera.R), np.asarray(camera.t)
    for _ in range(_ROUNDS):
        here = world @ R.T + t
        ahead = here[:, 2] > 1.0
        if ahead.sum() < _LEAST:
            return None
        step = _step(here[ahead], pixels[ahead], np.asarray(camera.K), move=move)
        turn = matrix_from_vector(step[:3])
        R, t = turn @ R, turn @ t + step[3:]
        if np.abs(step[:3]).max() < 1e-7:
            break
    left, _, right = np.linalg.svd(R)
    return altered(camera, R=left @ right, t=t)


def _step(here: Array, pixels: Array, K: Array, *, move: bool) -> Array:
    """Rotation vector and translation (6,) of one Gauss–Newton step; `here` (n, 3) in the camera's frame."""
    x, y, z = here.T
    focal = np.array([K[0, 0], K[1, 1]])
    residual = pixels - here[:, :2] / z[:, None] * focal - K[:2, 2]
    zero = np.zeros_like(z)
    jacobian = _per_point([[1 / z, zero, -x / z**2], [zero, 1 / z, -y / z**2]]) * focal[None, :, None]
    # d(exp(ω)p + δ) = −[p]ₓ ω + δ
    cross = _per_point([[zero, z, -y], [-z, zero, x], [y, -x, zero]])
    rows = np.concatenate([jacobian @ cross, jacobian], axis=2) if move else jacobian @ cross
    distance = np.linalg.norm(residual, axis=1)
    weight = np.exp(-0.5 * (distance / (2.0 * max(float(np.median(distance)), 1e-6))) ** 2)
    root = np.sqrt(weight)[:, None]
    scale = np.array([1.0, 1.0, 1.0] + [1e-3] * 3 * move)  # mm and radians
    left = (rows * root[..., None]).reshape(-1, rows.shape[2]) / scale
    solution = np.linalg.lstsq(left, (residual * root).ravel(), rcond=1e-8)[0] / scale
    return np.concatenate([solution, np.zeros(6 - solution.size)])


def _per_point(entries: list[list[Array]]) -> Array:
    """Matrices (n, …) of entries (n,)."""
    return np.ascontiguousarray(np.moveaxis(np.array(entries), -1, 0))
