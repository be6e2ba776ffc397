"""Simulated recordings of several people, with the truth: who is where, and whom each detection shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from skelsplat import layouts
from skelsplat._arrays import Array, Index, Mask, largest_slots, numbers, take_people
from skelsplat._skelsplat import Camera, Layout, project
from skelsplat.cameras import CameraRig, mm_per_unit
from skelsplat.exceptions import InvalidInputError
from skelsplat.synthetic.crowding import Crowding, Instances, View, behind
from skelsplat.synthetic.crowds import ROOM_MM, crowd
from skelsplat.synthetic.detections import corrupt, true_pixels
from skelsplat.synthetic.motions import motion
from skelsplat.synthetic.noise import SIZE_IN_ROOM, DetectionNoise, Memory, stream
from skelsplat.synthetic.skeleton import in_layout

_BYSTANDER_AT = 1.15  # from the centre of the room, as a share of its radius
_PEOPLE, _BYSTANDER, _DETECTORS, _CROWDING, _SLOTS = range(5)  # what the random streams are for


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """Q people in T frames of M views: up to P detections of N joints per view, and the truth."""

    people: Array  #: (T, M, P, N, 3), u, v, confidence; NaN where nothing is. The order in P is random.
    owner: Index  #: (T, M, P), the person of most of a detection's joints; −1 = false or no detection.
    joint_owner: Index  #: (T, M, P, N), the person whom each joint shows; −1 = nobody.
    truth: Array  #: (Q, T, N, 3) mm; NaN where a person is not in the room.
    visible: Mask  #: (Q, T, M, N), in the image, and neither another person nor a wall hides it.
    cameras: CameraRig
    layout: Layout
    fps: float

    def slots(self) -> Index:
        """Place in P of each person, (Q, T, M); −1 = not detected. Of two parts of a person the larger."""
        return largest_slots(self.people, self.owner, len(self.truth))

    def detections(self) -> Array:
        """Return the detections of each person, (Q, T, M, N, 3), as a perfect association has them."""
        return take_people(self.people, self.slots())

    def optional(self, least_views: int = 2) -> Mask:
        """Who need not be found, (Q, T): detected in fewer than `least_views` views, or not there."""
        return np.asarray((self.slots() >= 0).sum(axis=-1) < least_views)


def simulate_scene(
    people: int | Sequence[ArrayLike],
    cameras: CameraRig | Sequence[Camera],
    *,
    n_frames: int = 300,
    fps: float = 30.0,
    meetings: Sequence[str] = ("cross", "handover", "circle"),
    bystander: bool = False,
    noise: DetectionNoise | None = None,
    crowding: Crowding | None = None,
    layout: str | Layout = "h36m17",
    seed: int = 0,
) -> Scene:
    """Simulate a recording of several people.

    `people` are their number, for `crowd` with `n_frames` and `meetings`, or poses (T, N, 3) mm of your own,
    each person where they are, NaN where absent. Cameras are in mm; ``ring(4, radius_mm=4500)`` fits the room
    and has all cameras at one height, the hardest case for telling people apart. A `bystander` at the edge of
    the room is the last person, whom walls hide from all but two cameras. `noise` is of each person alone,
    by default ``DetectionNoise.recording(fps)`` in proportion to the size of people in the images, `crowding`
    what goes wrong because there are several; the people depend on neither.
    """
    rig = cameras if isinstance(cameras, CameraRig) else CameraRig(list(cameras))
    if mm_per_unit(rig) != 1.0:
        raise InvalidInputError(f"cameras: expected a rig in mm, got one in {rig.unit}")
    skeleton = layouts.get(layout) if isinstance(layout, str) else layout
    eyes = np.array([-np.asarray(c.R).T @ np.asarray(c.t) for c in rig])
    if isinstance(people, int | np.integer):
        moving = crowd(
            int(people), n_frames, fps=fps, meetings=meetings, eyes=eyes, seed=stream(seed, _PEOPLE)
        )
        truth = in_layout(moving, skeleton)
    else:
        truth = _poses(people, len(skeleton.joints))
    walls = np.zeros((len(truth), len(rig)), dtype=bool)
    if bystander:
        own, hidden_from = _bystander(truth.shape[1], fps, rig, skeleton, stream(seed, _BYSTANDER))
        truth, walls = np.concatenate([truth, own[None]]), np.concatenate([walls, hidden_from[None]])
    # Size of people in the middle of the room: focal length, px, over distance, mm; median of the views.
    size = np.median([c.K[0, 0] / d for c, d in zip(rig, np.linalg.norm(eyes, axis=1), strict=True)])
    usual = DetectionNoise.recording(fps).scaled(float(size) / SIZE_IN_ROOM)
    return _detected(truth, walls, rig, skeleton, fps, noise or usual, crowding or Crowding(), seed)


def _poses(people: Sequence[ArrayLike], n_joints: int) -> Array:
    given = [numbers(one, f"people[{k}]") for k, one in enumerate(people)]
    shapes = {one.shape for one in given}
    if len(shapes) != 1 or len(given[0].shape) != 3 or given[0].shape[1:] != (n_joints, 3):
        raise InvalidInputError(f"people: expected poses (T, {n_joints}, 3) of one T, got {sorted(shapes)}")
    return np.stack(given)


def _bystander(
    n_frames: int, fps: float, rig: CameraRig, layout: Layout, rng: np.random.Generator
) -> tuple[Array, Mask]:
    """Somebody at the edge of the room, (T, N, 3), and the views (M,) from which a wall hides them."""
    angle = rng.uniform(0.0, 2 * np.pi)
    pose = motion(str(rng.choice(["wave", "turn"])), n_frames, fps=fps, seed=rng)
    at = _BYSTANDER_AT * ROOM_MM * np.array([np.cos(angle), np.sin(angle)])
    pose[..., :2] += at - pose[:, :1, :2].mean(axis=0)
    joints = np.isfinite(true_pixels(pose, rig)[..., 0]).sum(axis=(0, 2))
    hidden = np.ones(len(rig), dtype=bool)
    hidden[np.argsort(-joints, kind="stable")[:2]] = False
    return in_layout(pose, layout), hidden


def _detected(
    truth: Array,
    walls: Mask,
    rig: CameraRig,
    layout: Layout,
    fps: float,
    noise: DetectionNoise,
    crowding: Crowding,
    seed: int,
) -> Scene:
    """Detect people (Q, T, N, 3), view by view, and put the detections of a frame in random order."""
    pixels = np.stack([true_pixels(one, rig) for one in truth])  # (Q, T, M, N, 2)
    pixels[np.broadcast_to(walls[:, None, :], pixels.shape[:3])] = np.nan
    alone = np.stack(
        [corrupt(one, noise, layout, stream(seed, _DETECTORS, q)) for q, one in enumerate(pixels)]
    )
    visible = np.isfinite(pixels[..., 0])
    memory = noise.memory or Memory(frame_rate=fps)
    views: list[Instances] = []
    for m, camera in enumerate(rig):
        depth = (truth @ np.asarray(camera.R).T + np.asarray(camera.t))[..., 2]
        depth[walls[:, m]] = np.nan
        everywhere = np.asarray(project(truth, [camera]))[0]
        hidden = behind(everywhere, depth, float(camera.K[0, 0]), layout)
        visible[:, :, m] &= hidden < 0
        size = (int(camera.size[0]), int(camera.size[1]))
        rng = stream(seed, _CROWDING, m)
        view = View(alone[:, :, m], hidden, depth.mean(axis=-1), size, layout, crowding, memory, rng)
        views.append(view.instances())
    found, joint_owner = _packed(views, stream(seed, _SLOTS))
    votes = np.stack([(joint_owner == q).sum(axis=-1) for q in range(len(truth))], axis=-1)
    owner = np.where(votes.any(axis=-1), votes.argmax(axis=-1), -1)
    return Scene(found, owner, joint_owner, truth, visible, rig, layout, fps)


def _packed(views: Sequence[Instances], rng: np.random.Generator) -> tuple[Array, Index]:
    """Put the detections into (T, M, P, N, 3), owners (T, M, P, N), in random order in P."""
    most = max(len(view) for view in views)
    n_frames, n_joints = views[0][0][1].shape
    found = np.full((n_frames, len(views), most, n_joints, 3), np.nan)
    owner = np.full(found.shape[:-1], -1, dtype=np.int64)
    for m, view in enumerate(views):
        for k, (seen, own) in enumerate(view):
            found[:, m, k], owner[:, m, k] = seen, own
    there = np.isfinite(found[..., 0]).any(axis=-1)
    used = int(there.sum(axis=-1).max(initial=1))
    # Shuffled, with those that are there in front; then shuffled again among the places that are left.
    order = np.where(there, rng.random(there.shape), 2.0).argsort(axis=-1)[..., :used]
    again = rng.random(order.shape).argsort(axis=-1)
    order = np.take_along_axis(order, again, axis=-1)[..., None]
    owners = np.take_along_axis(owner, order, axis=2)
    return np.take_along_axis(found, order[..., None], axis=2), owners
