"""What parts of a long recording add up to: counts of all frames, and every so many-th frame as a run."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Index
from skelsplat._sequence import frames_of, joined
from skelsplat.findings import Finding
from skelsplat.io import PoseData
from skelsplat.io.poses._parts import PoseParts, PoseStore
from skelsplat.run.findings import JointFrames, joint_frames
from skelsplat.run.frames import FrameFacts, Usual, find_in_frames
from skelsplat.run.read import Inputs, Thinned
from skelsplat.run.solve import Outcome, poses_of
from skelsplat.run.summary import Statistics, summarise

# Frames that medians, findings, figures and the page are from, at least half of these.
DRAWN = 10_000
# Frames of each joint that a finding names, and single frames that are named in all.
MOST_NAMED, MOST_SINGLE = 10_000, 50_000


@dataclass(frozen=True)
class _Sample:
    """The frames of a part that are drawn."""

    inputs: Inputs
    outcome: Outcome


class Gathered:
    """Takes the parts of a recording in order; ``whole`` has its cameras and frames, and no detections."""

    def __init__(self, whole: Inputs, config: sk.RefineConfig, folder: Path) -> None:
        self._whole, self._config, self._folder = whole, config, folder
        self._every = -(-len(whole.frames) // DRAWN)
        self._poses = PoseStore(folder)
        self._samples: list[_Sample] = []
        self._counts: list[Statistics] = []
        self._facts: list[Path] = []
        self._last: PoseData | None = None
        self.joint_frames: JointFrames = {}
        self.joint_counts = Counter[Any]()

    def add(self, part: slice, inputs: Inputs, result: sk.Refinement) -> None:
        """Add the frames of a part."""
        outcome = Outcome.of(result, self._config, inputs)
        statistics = summarise(inputs, outcome)
        self._last = poses_of(inputs, result)
        self._poses.append(self._last)
        self._counts.append(statistics.counts())
        self._note(FrameFacts.of(inputs, outcome, statistics, self._last.joint_status))
        self._name(joint_frames(inputs, outcome, self._last.joint_status))
        drawn = np.arange(-part.start % self._every, part.stop - part.start, self._every)
        if len(drawn):
            self._samples.append(_Sample(_some(inputs, drawn), _drawn(outcome, drawn)))

    def _note(self, facts: FrameFacts) -> None:
        path = self._folder / f"facts_{len(self._facts)}.npz"
        np.savez(path, **asdict(facts))
        self._facts.append(path)

    def _name(self, found: JointFrames) -> None:
        for place, by_joint in found.items():
            for joint, frames in by_joint.items():
                named = self.joint_frames.setdefault(place, {}).setdefault(joint, [])
                named += frames[: MOST_NAMED - len(named)]
                self.joint_counts[(*place, joint)] += len(frames)

    @property
    def named_all(self) -> bool:
        """Whether `joint_frames` has every frame."""
        named = sum(len(frames) for one in self.joint_frames.values() for frames in one.values())
        return named == self.joint_counts.total()

    def sample(self, seconds: float, alone: str) -> tuple[Inputs, Outcome, Statistics]:
        """Return the run of the frames drawn, whose counts are those of all."""
        inputs, outcomes = [one.inputs for one in self._samples], [one.outcome for one in self._samples]
        frames = self._whole.frames
        drawn = replace(
            self._whole,
            detections=np.concatenate([one.detections for one in inputs]),
            unmatched=np.concatenate([one.unmatched for one in inputs]),
            frames=np.concatenate([one.frames for one in inputs]),
            thinned=Thinned(len(frames), int(frames[0]), int(frames[-1]), self._every),
        )
        outcome = replace(
            outcomes[0],
            result=joined([one.result for one in outcomes]),
            start=np.concatenate([one.start for one in outcomes]),
            seconds=seconds,
            alone=alone,
        )
        return drawn, outcome, summarise(drawn, outcome).with_counts_of(self._counts)

    def in_frames(self, drawn: Inputs, outcome: Outcome, statistics: Statistics) -> tuple[list[Finding], int]:
        """Return the findings on single frames as `find_in_frames`, by what is usual in those drawn."""
        status = np.asarray(outcome.result.joint_status)
        usual = Usual.of(FrameFacts.of(drawn, outcome, statistics, status))
        everywhere = [(facts.status == "unobserved").all(axis=0) for facts in self._read()]
        steps = statistics.stop_reasons
        at_limit = steps.get("max_steps", 0) > sum(steps.values()) / 2
        usual = replace(usual, unobserved=np.logical_and.reduce(everywhere), at_step_limit=at_limit)
        names = drawn.layout.joints, drawn.rig.names
        return find_in_frames(self._read(), usual, *names, most=MOST_SINGLE)

    def _read(self) -> Iterator[FrameFacts]:
        for path in self._facts:
            with np.load(path) as arrays:
                yield FrameFacts(**arrays)

    def poses(self, size: int) -> PoseParts:
        """Return the poses of all frames."""
        if self._last is None:
            raise TypeError("no part was added")
        return self._poses.parts(self._last, self._whole.frames, size)


def _some(inputs: Inputs, rows: Index) -> Inputs:
    parts = {name: getattr(inputs, name)[rows] for name in ("detections", "unmatched", "frames")}
    return replace(inputs, **parts)


def _drawn(outcome: Outcome, rows: Index) -> Outcome:
    return replace(outcome, result=frames_of(outcome.result, rows), start=outcome.start[rows])
