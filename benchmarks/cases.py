"""Cases in which a result was once wrong without a word: what is measured, and what is wanted.

    python benchmarks/cases.py [--only wrists --only standing] [--takes 6]

CMU motion capture (or else the package's own motions) and simulated detections with errors that last
(`synthetic.Memory`), at 30 Hz in four cameras, all with confidence 1 unless a case says otherwise. "ok 93 of
80 %": 80 % of the joints are ok, and of these 93 % lie within three standard deviations. `--only` selects
cases by a part of their names; `--takes` is the number of recordings of each.
"""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import hard
import lab
import numpy as np
import recordings
from hard import BODY, FPS, FRAMES, WRIST, WRISTS, Drawn
from lab import Table
from scenarios import FloatArray, Scene

import skelsplat as sk
from skelsplat import layouts, synthetic
from skelsplat.io import write_calibration
from skelsplat.run import Job, run

WAYS = {"frames": False, "over time": True}
Row = tuple[str, str, str]  # what is measured, the figures, and what is wanted


def solved(scene: Scene, over_time: bool, **fields: Any) -> sk.Refinement:
    """Solve frame by frame or over time."""
    given = {"layout": BODY, "config": sk.RefineConfig(**fields)}
    if over_time:
        return sk.refine_sequence(scene.detections, scene.rig, fps=FPS, **given)
    return sk.refine(None, scene.detections, scene.rig, **given)


def bars(
    scenes: Sequence[Scene],
    results: Sequence[sk.Refinement],
    joints: Any = slice(None),
    frames: slice = slice(None),
) -> str:
    """Return how many joints are ok or inferred, and how many of these lie within three sigma."""
    inside, status = [], []
    for scene, result in zip(scenes, results, strict=True):
        three = sk.metrics.sigma_coverage(result.pose, result.uncertainty, scene.truth, reduce="none")[2]
        inside.append(three[frames][:, joints].ravel())
        status.append(result.joint_status[frames][:, joints].ravel())
    within, words = np.concatenate(inside), np.concatenate(status)
    found = {name: within[(words == name) & np.isfinite(within)] for name in ("ok", "inferred")}
    parts = [(name, own.mean(), len(own) / len(words)) for name, own in found.items() if len(own)]
    return ", ".join(f"{name} {100 * own:.0f} of {100 * all_of:.0f} %" for name, own, all_of in parts)


def both_ways(
    name: str, scenes: Sequence[Scene], wanted: str, fields: dict[str, Any] | None = None, **given: Any
) -> Iterator[Row]:
    """Yield the bars of frames alone and over time."""
    for way, over_time in WAYS.items():
        results = [solved(one, over_time, **(fields or {})) for one in scenes]
        yield f"{name}, {way}", bars(scenes, results, **given), wanted


def said(scenes: Sequence[Scene]) -> str:
    """Return the kinds of warnings of `skelsplat refine` on files with these detections, and in how many."""
    kinds = Counter[str]()
    for one in scenes:
        with tempfile.TemporaryDirectory() as folder:
            cameras, file = Path(folder, "rig.toml"), Path(folder, "detections.npz")
            write_calibration(cameras, one.rig)
            np.savez(file, detections=one.detections, camera_names=one.rig.names)
            found = run(Job(cameras, file, unit="mm", layout="h36m17", fps=FPS)).findings
        kinds.update({finding.kind for finding in found if finding.severity != "note"})
    words = [f"{kind} {count}/{len(scenes)}" for kind, count in sorted(kinds.items())]
    return f"said: {', '.join(words) or 'nothing'}"


def clocks(reports: Sequence[sk.RigAdjustment]) -> str:
    """Return how many sound cameras are called late, by how much at most, and how many are moved."""
    every = [one for report in reports for one in report.report]
    late = [one for one in every if one.status in ("late", "adjusted") and one.clock]
    worst = max(late, key=lambda one: abs(one.clock), default=None)
    by = "" if worst is None else f" by up to {worst.clock:+.2f} ± {worst.clock_sigma:.2f} frames"
    placed = sum(one.status == "adjusted" and one.degrees + one.distance > 0 for one in every)
    return f"{len(late)} of {len(every)} late{by}, {placed} moved"


def in_step(motions: Sequence[FloatArray]) -> str:
    """Return what becomes of the clocks of cameras in step that see motions (T, 17, 3) mm."""
    rig = synthetic.human36m_like()
    found = [hard.seen(motion, rig, k) for k, motion in enumerate(motions)]
    return clocks([sk.adjust_cameras(detections, rig, clock=True) for detections in found])


def errors(scene: Scene, result: sk.Refinement, frames: slice, joints: Any = slice(None)) -> str:
    """Return the error and the status of joints in some frames."""
    mm = np.linalg.norm(result.pose - scene.truth, axis=-1)[frames][:, joints]
    ok = 100 * float((result.joint_status[frames][:, joints] == "ok").mean())
    return f"{np.nanmean(mm):.0f} mm, {ok:.0f} % ok"


def confidences(drawn: Drawn) -> Iterator[Row]:
    """Give one camera ten times the others' confidences or weight."""
    scenes, wanted = drawn.scenes(), "≥ 92 %, inferred ≥ 85 %"
    factor = np.ones((4, 1, 3))
    factor[1:, :, 2] = 0.1
    scaled = [replace(one, detections=factor * one.detections) for one in scenes]
    yield from both_ways("confidences 1, 0.1, 0.1, 0.1", scaled, wanted)
    yield from both_ways("view_weights=[10, 1, 1, 1]", scenes, wanted, {"view_weights": [10, 1, 1, 1]})


def wrists(drawn: Drawn) -> Iterator[Row]:
    """Add noise to the wrists, from frame to frame."""
    for px in (6, 10, 20):
        rng, noisy = drawn.rng(px), []
        for one in drawn.scenes():
            noisy.append(hard.moved(one, px * rng.normal(size=(len(one.truth), 4, 2, 2)), WRISTS))
        yield from both_ways(f"wrists + {px} px", noisy, "≥ 88 %, or weak", joints=WRISTS)


def second_half(drawn: Drawn) -> Iterator[Row]:
    """Let the detector get worse half-way through."""
    noisy, half = [], slice(FRAMES // 2, None)
    for scene in drawn.scenes():
        added = 15.0 * drawn.rng(2).normal(size=(*scene.detections.shape[:3], 2))
        added[: half.start] = 0.0
        noisy.append(hard.moved(scene, added))
    results = [solved(one, True) for one in noisy]
    inside = f"{bars(noisy, results)}; second half {bars(noisy, results, frames=half)}"
    yield "15 px more in the second half, over time", inside, "≥ 90 %"


def large_noise(drawn: Drawn) -> Iterator[Row]:
    """Let the estimated noise be 33 and 46 mm."""
    for factor in (2.2, 3.0):
        shares, noise = [], []
        for k, scene in enumerate(drawn.scenes()):
            found = solved(replace(scene, detections=hard.seen(scene.truth, scene.rig, k, factor)), True)
            shares.append(sk.metrics.sigma_coverage(found.pose, found.uncertainty, scene.judged))
            noise.append(np.median(found.noise))
        inside = "/".join(f"{100 * share:.0f}" for share in np.mean(shares, axis=0))
        yield f"errors × {factor:g}, over time", f"{inside} % (noise {np.mean(noise):.0f} mm)", "20/74/97 ± 8"


def standing(drawn: Drawn) -> Iterator[Row]:
    """Let a person hardly move, all cameras in step."""
    for name in ("standing", "sitting"):
        motions = [hard.still(name, drawn.rng(3, k)) for k in range(drawn.takes)]
        yield f"{name} still", in_step(motions), "none late"


def periodic(drawn: Drawn) -> Iterator[Row]:
    """Repeat one movement, all cameras in step."""
    for name, hz in product(("squats", "curls", "cycling"), (1.0, 1.5, 2.0)):
        motions = [hard.exercise(name, hz, drawn.rng(4, k)) for k in range(drawn.takes)]
        yield f"{name} at {hz:g} Hz", in_step(motions), "none late or moved"


def two_sizes(drawn: Drawn) -> Iterator[Row]:
    """Show two people of another size, one after the other."""
    for sizes in ((1.57, 1.93), (0.91, 1.80)):
        scenes = []
        for k, scene in enumerate(drawn.scenes()):
            truth = scene.truth * np.repeat(sizes, FRAMES // 2)[:, None, None] / 1.75
            noise = recordings.noise("occluded 2", 4, FPS)
            found = synthetic.simulate_detections(truth, scene.rig, noise=noise, layout=BODY, seed=k)
            scenes.append(recordings.unsure(replace(scene, truth=truth, detections=found)))
        figures = f"{bars(scenes, [solved(one, True) for one in scenes])}; {said(scenes)}"
        yield f"{sizes[0]} m, then {sizes[1]} m", figures, "≥ 90 %, split or said"


def all_off(drawn: Drawn) -> Iterator[Row]:
    """Let all calibrations be off by 20 px, each in another direction."""
    scenes = []
    for k, scene in enumerate(drawn.scenes()):
        angle = drawn.rng(6, k).uniform(0, 2 * np.pi, 4)
        scenes.append(hard.moved(scene, 20.0 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)[:, None]))
    yield from both_ways("all cameras off by 20 px", scenes, "≥ 85 %, or weak")
    yield "all cameras off by 20 px", said(scenes), "a finding"


def mistaken(drawn: Drawn) -> Iterator[Row]:
    """Let most views agree on something else for ten frames."""
    scene, part = drawn.scenes()[0], slice(100, 110)
    thing = scene.truth[100, WRIST] + [1200.0, 1600.0, 0.0]
    wrong = replace(scene, detections=scene.detections.copy())
    wrong.detections[part, :3, WRIST, :2] = np.asarray(sk.project(thing[None], scene.rig))[:3, 0]
    swapped = hard.exchanged(scene, part, range(4), range(17))
    for way, over_time in WAYS.items():
        result = solved(wrong, over_time)
        forearm = np.linalg.norm(result.pose[part, WRIST] - result.pose[part, WRIST - 1], axis=-1)
        figures = f"{errors(scene, result, part, [WRIST])}, forearm {np.nanmean(forearm):.0f} mm"
        yield f"a wrist taken for a thing in three views, {way}", figures, "not ok, or right"
        yield f"sides exchanged, {way}", errors(scene, solved(swapped, over_time), part), "over time right"
    yield "sides exchanged", said([swapped]), "said, or right"


def world(drawn: Drawn) -> Iterator[Row]:
    """Show the same pixels of a smaller or larger world."""
    body = layouts.from_names("body", BODY.joints, BODY.limbs)
    for condition in ("good", "occluded 2"):
        mm = []
        for scale in (1.0, 0.05, 0.2, 5.0, 10.0):
            errors = []
            for scene in drawn.scenes(condition):
                rig = [sk.Camera(c.K, c.R, scale * np.asarray(c.t), size=c.size) for c in scene.rig]
                found = sk.refine_sequence(scene.detections, rig, fps=FPS, layout=body)
                errors.append(scene.mpjpe(found.pose / scale))
            mm.append(np.mean(errors))
        times = ", ".join(f"{one / mm[0]:.2f}" for one in mm[1:])
        yield f"world × 0.05, 0.2, 5, 10, {condition}", f"error × {times}", "1"


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
            rows = {name: (found, wanted) for name, found, wanted in case(Drawn(takes, seed))}
            yield lab.wanted(f"{case.__name__}: {case.__doc__}", rows)


if __name__ == "__main__":
    lab.main(__doc__, cases)
