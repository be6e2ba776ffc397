"""Cases in which a result was once wrong without a word; what is wanted is in test_cases_time.py.

    python benchmarks/cases.py [--only wrists --only standing] [--takes 6]

CMU motion capture (or else the package's own motions) and simulated detections with errors that last
(`synthetic.Memory`), at 30 Hz in four cameras, all with confidence 1 unless a case says otherwise. "ok 93 of
80 %": 80 % of the joints are ok, and of these 93 % lie within three standard deviations.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import lab
import numpy as np
import recordings
from lab import Table
from scenarios import FloatArray, Scene

import skelsplat as sk
from skelsplat import layouts, synthetic
from skelsplat.run import Run
from skelsplat.synthetic.skeleton import ANKLE_HEIGHT_MM, forward_kinematics

FPS, FRAMES = 30.0, 300
BODY = layouts.H36M17
ANKLES, WRIST, WRISTS = [3, 6], 13, [13, 16]
Row = tuple[str, str]  # what is measured, and the figures


@dataclass(frozen=True)
class Drawn:
    """How many recordings a case has, and their seed."""

    takes: int
    seed: int

    def scenes(self) -> list[Scene]:
        """Return recordings of ten seconds."""
        every = recordings.motions()
        long = [name for name in sorted(every) if len(every[name]) >= FRAMES]
        names = recordings.sample(long, self.takes, self.seed)
        given = {"names": names, "seed": self.seed, "most_frames": FRAMES, "confidence": False}
        return [take.scene for take in recordings.takes("good", **given)]

    def rng(self, *key: int) -> np.random.Generator:
        """Return the random numbers of a part of a case."""
        return np.random.default_rng([self.seed, *key])


def seen(poses: FloatArray, rig: Sequence[sk.Camera], seed: int, factor: float = 1.0) -> FloatArray:
    """Return the detections of poses (T, 17, 3) mm by a detector with errors that last."""
    noise = synthetic.DetectionNoise.recording(FPS).scaled(factor)
    found = synthetic.simulate_detections(poses, rig, noise=noise, layout=BODY, seed=seed)
    found[..., 2] = np.where(np.isfinite(found[..., 0]), 1.0, 0.0)
    return found


def moved(scene: Scene, by: FloatArray, joints: Sequence[int] | slice = slice(None)) -> Scene:
    """Return the scene with pixels added to the detections of some joints."""
    detections = scene.detections.copy()
    detections[:, :, joints, :2] += by
    return replace(scene, detections=detections)


def exchanged(scene: Scene, frames: slice, views: Sequence[int], joints: Sequence[int]) -> Scene:
    """Return the scene with left and right exchanged."""
    detections = scene.detections.copy()
    mirrored = layouts.mirror_images(17, BODY.left_right)[list(joints)]
    for view in views:
        detections[frames, view, joints] = scene.detections[frames, view][:, mirrored]
    return replace(scene, detections=detections)


def exercise(name: str, hz: float, rng: np.random.Generator) -> FloatArray:
    """Return ten seconds of one exercise on the spot, each repetition as the last, (T, 17, 3) mm."""
    phase = 2 * np.pi * hz * np.arange(FRAMES) / FPS + rng.uniform(0, 2 * np.pi)
    bent, angles = 0.5 - 0.5 * np.cos(phase), {"lean": 5.0}
    for side, shift in (("l", 0.0), ("r", np.pi)):
        hip, knee, elbow = {
            "standing": (3.0, 6.0, 20.0),
            "sitting": (85.0, 85.0, 60.0),
            "squats": (85 * bent, 95 * bent, 20.0),
            "curls": (3.0, 6.0, 20 + 110 * bent),
            "cycling": (60 + 25 * np.cos(phase + shift), 70 + 35 * np.cos(phase + shift + 1.0), 20.0),
        }[name]
        angles |= {f"hip_flexion_{side}": hip, f"knee_flexion_{side}": knee, f"elbow_flexion_{side}": elbow}
    pose = forward_kinematics(angles, rng.uniform(0, 360), n_frames=FRAMES)
    lowest = pose[:, ANKLES, 2].min(axis=1)
    floor = np.full(FRAMES, lowest.min()) if name == "cycling" else lowest
    pose[..., 2] += (ANKLE_HEIGHT_MM - floor)[:, None]
    return pose


def still(name: str, rng: np.random.Generator) -> FloatArray:
    """Return a person who stands or sits and sways by a few millimetres, (T, 17, 3) mm."""
    body = exercise(name, 0.0, rng)
    hz, phase = rng.uniform(0.15, 0.6, (3, 3)), rng.uniform(0, 2 * np.pi, (3, 3))
    when = np.arange(FRAMES)[:, None, None] / FPS
    sway = 3.0 * np.sin(2 * np.pi * hz * when + phase).sum(axis=1) * [1.0, 1.0, 0.1]
    return body + sway[:, None] * body[..., 2:] / 1000.0


def solved(scene: Scene) -> sk.SequenceRefinement:
    """Solve over time."""
    return sk.refine_sequence(scene.detections, scene.rig, fps=FPS, layout=BODY)


def bars(scenes: Sequence[Scene], joints: Any = slice(None), frames: slice = slice(None)) -> str:
    """Return how many joints are ok or inferred, and how many of these lie within three sigma."""
    inside, status = [], []
    for scene in scenes:
        result = solved(scene)
        three = sk.metrics.sigma_coverage(result.pose, result.uncertainty, scene.truth, reduce="none")[2]
        inside.append(three[frames][:, joints].ravel())
        status.append(result.joint_status[frames][:, joints].ravel())
    within, words = np.concatenate(inside), np.concatenate(status)
    found = {name: within[(words == name) & np.isfinite(within)] for name in ("ok", "inferred")}
    parts = [(name, own.mean(), len(own) / len(words)) for name, own in found.items() if len(own)]
    return ", ".join(f"{name} {100 * own:.0f} of {100 * all_of:.0f} %" for name, own, all_of in parts)


def said(scenes: Sequence[Scene]) -> str:
    """Return the kinds of warnings of runs on these detections, and in how many."""
    kinds = Counter[str]()
    for one in scenes:
        found = Run.from_arrays(solved(one), one.rig, one.detections, BODY, fps=FPS).findings
        kinds.update({finding.kind for finding in found if finding.severity != "note"})
    words = [f"{kind} {count}/{len(scenes)}" for kind, count in sorted(kinds.items())]
    return f"said: {', '.join(words) or 'nothing'}"


def in_step(motions: Sequence[FloatArray]) -> str:
    """Return how many cameras in step that see motions (T, 17, 3) are called late, by how much, or moved."""
    rig = synthetic.human36m_like()
    detections = (seen(motion, rig, k) for k, motion in enumerate(motions))
    every = [one for each in detections for one in sk.adjust_cameras(each, rig, clock=True).report]
    late = [one for one in every if one.status in ("late", "adjusted") and one.clock]
    worst = max(late, key=lambda one: abs(one.clock), default=None)
    by = "" if worst is None else f" by up to {worst.clock:+.2f} ± {worst.clock_sigma:.2f} frames"
    placed = sum(one.status == "adjusted" and one.degrees + one.distance > 0 for one in every)
    return f"{len(late)} of {len(every)} late{by}, {placed} moved"


def errors(scene: Scene, frames: slice, joints: Any = slice(None)) -> str:
    """Return the error and the status of joints in some frames."""
    result = solved(scene)
    mm = np.linalg.norm(result.pose - scene.truth, axis=-1)[frames][:, joints]
    ok = 100 * float((result.joint_status[frames][:, joints] == "ok").mean())
    return f"{np.nanmean(mm):.0f} mm, {ok:.0f} % ok"


def confidences(drawn: Drawn) -> Iterator[Row]:
    """Give one camera ten times the others' confidences."""
    factor = np.ones((4, 1, 3))
    factor[1:, :, 2] = 0.1
    scaled = [replace(one, detections=factor * one.detections) for one in drawn.scenes()]
    yield "confidences 1, 0.1, 0.1, 0.1", bars(scaled)


def wrists(drawn: Drawn) -> Iterator[Row]:
    """Add noise to the wrists, from frame to frame."""
    for px in (6, 10, 20):
        rng, noisy = drawn.rng(px), []
        for one in drawn.scenes():
            noisy.append(moved(one, px * rng.normal(size=(len(one.truth), 4, 2, 2)), WRISTS))
        yield f"wrists + {px} px", bars(noisy, WRISTS)


def second_half(drawn: Drawn) -> Iterator[Row]:
    """Let the detector get worse half-way through."""
    noisy, half = [], slice(FRAMES // 2, None)
    for scene in drawn.scenes():
        added = 15.0 * drawn.rng(2).normal(size=(*scene.detections.shape[:3], 2))
        added[: half.start] = 0.0
        noisy.append(moved(scene, added))
    yield "15 px more in the second half, there", bars(noisy, frames=half)


def large_noise(drawn: Drawn) -> Iterator[Row]:
    """Let the estimated noise be 46 mm."""
    shares = []
    for k, scene in enumerate(drawn.scenes()):
        found = solved(replace(scene, detections=seen(scene.truth, scene.rig, k, 3.0)))
        shares.append(sk.metrics.sigma_coverage(found.pose, found.uncertainty, scene.judged))
    inside = "/".join(f"{100 * share:.0f}" for share in np.mean(shares, axis=0))
    yield "errors × 3", f"{inside} %"


def standing(drawn: Drawn) -> Iterator[Row]:
    """Let a person hardly move, all cameras in step."""
    for name in ("standing", "sitting"):
        motions = [still(name, drawn.rng(3, k)) for k in range(drawn.takes)]
        yield f"{name} still", in_step(motions)


def periodic(drawn: Drawn) -> Iterator[Row]:
    """Repeat one movement, all cameras in step."""
    for name, hz in product(("squats", "curls", "cycling"), (1.0, 1.5, 2.0)):
        motions = [exercise(name, hz, drawn.rng(4, k)) for k in range(drawn.takes)]
        yield f"{name} at {hz:g} Hz", in_step(motions)


def two_sizes(drawn: Drawn) -> Iterator[Row]:
    """Show two people of another size, one after the other."""
    scenes, sizes = [], (1.57, 1.93)
    for k, scene in enumerate(drawn.scenes()):
        truth = scene.truth * np.repeat(sizes, FRAMES // 2)[:, None, None] / 1.75
        noise = recordings.noise("occluded 2", 4, FPS)
        found = synthetic.simulate_detections(truth, scene.rig, noise=noise, layout=BODY, seed=k)
        scenes.append(recordings.unsure(replace(scene, truth=truth, detections=found)))
    yield f"{sizes[0]} m, then {sizes[1]} m", f"{bars(scenes)}; {said(scenes)}"


def all_off(drawn: Drawn) -> Iterator[Row]:
    """Let all calibrations be off by 20 px, each in another direction."""
    scenes = []
    for k, scene in enumerate(drawn.scenes()):
        angle = drawn.rng(6, k).uniform(0, 2 * np.pi, 4)
        scenes.append(moved(scene, 20.0 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)[:, None]))
    yield "all cameras off by 20 px", bars(scenes)


def mistaken(drawn: Drawn) -> Iterator[Row]:
    """Let most views agree on something else for ten frames."""
    scene, part = drawn.scenes()[0], slice(100, 110)
    thing = scene.truth[100, WRIST] + [1200.0, 1600.0, 0.0]
    wrong = replace(scene, detections=scene.detections.copy())
    wrong.detections[part, :3, WRIST, :2] = np.asarray(sk.project(thing[None], scene.rig))[:3, 0]
    yield "a wrist taken for a thing in three views", errors(wrong, part, [WRIST])
    swapped = exchanged(scene, part, range(4), range(17))
    yield "sides exchanged", errors(swapped, part)


def world(drawn: Drawn) -> Iterator[Row]:
    """Show the same pixels of a larger world."""
    body, mm = layouts.from_names("body", BODY.joints, BODY.limbs), {1.0: 0.0, 10.0: 0.0}
    for scale in mm:
        for scene in drawn.scenes():
            rig = [sk.Camera(c.K, c.R, scale * np.asarray(c.t), size=c.size) for c in scene.rig]
            found = sk.refine_sequence(scene.detections, rig, fps=FPS, layout=body)
            mm[scale] += scene.mpjpe(found.pose / scale)
    yield "world × 10", f"error × {mm[10.0] / mm[1.0]:.2f}"


CASES = (
    confidences,
    wrists,
    second_half,
    large_noise,
    standing,
    periodic,
    two_sizes,
    all_off,
    mistaken,
    world,
)


def cases(*, only: tuple[str, ...] = (), takes: int = 6, seed: int = 0) -> Iterator[Table]:
    """Measure every case, or those that are named."""
    for case in CASES:
        if not only or any(text in case.__name__ for text in only):
            rows = {name: {"measured": found} for name, found in case(Drawn(takes, seed))}
            yield Table.of(f"{case.__name__}: {case.__doc__}", "what", rows)


if __name__ == "__main__":
    lab.main(__doc__, cases)
