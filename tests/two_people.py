"""Two people who walk past each other, seen by several cameras."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

import skelsplat as sk
from skelsplat import synthetic
from skelsplat.association import separate_people, take_people
from skelsplat.run.findings import find_findings
from skelsplat.run.frames import joint_frames
from skelsplat.run.people import find_people
from skelsplat.run.person import look_around, pick_places
from skelsplat.run.read import Inputs
from skelsplat.run.solve import Outcome
from skelsplat.run.summary import summarise
from skelsplat.synthetic import DetectionNoise

LAYOUT = sk.layouts.H36M17
FRAMES = 24


def crossing(frames=FRAMES, apart_mm=600.0):
    """Return two walks (T, 17, 3) in opposite directions along x, which pass at a distance."""
    walks = [synthetic.motion("walk", frames, seed=seed) for seed in (1, 7)]
    for pose, sign in zip(walks, (1.0, -1.0), strict=True):
        pose[..., :2] -= pose[:, :1, :2]
        pose[..., 0] += sign * np.linspace(-900.0, 900.0, frames)[:, None]
        pose[..., 1] -= sign * apart_mm / 2
    return walks


def seen(poses, rig, noise=None):
    """Return detections (T, M, P, 17, 3) of people (T, 17, 3) each, everybody in a slot of their own."""
    noise = DetectionNoise.good() if noise is None else noise
    found = [synthetic.simulate_detections(p, rig, noise=noise, seed=k) for k, p in enumerate(poses)]
    return np.stack([np.asarray(one) for one in found], axis=2)


def shuffled(people, seed=2):
    """Return people in another order in every view and frame, as OpenPose's files have them."""
    order = np.argsort(np.random.default_rng(seed).random(people.shape[:3]), axis=2)
    return np.take_along_axis(people, order[..., None, None], axis=2)


def picked(people, rig, person, layout=LAYOUT):
    """Return places, views without a match, and who is visible when ``person`` is chosen."""
    found = separate_people(people, rig, layout=layout)
    return (*pick_places(people, person, found), look_around((found >= 0).sum(axis=2)))


def doubts_of(people, rig, person="consistent"):
    """Return the sentences of a run with ``person`` on whether it follows one person."""
    index, _, crowd = picked(people, rig, person)
    chosen = take_people(people, index)
    frames = np.arange(len(people))
    inputs = Inputs(rig, LAYOUT, chosen, index < 0, frames, person=person, crowd=crowd)
    result = sk.refine(None, chosen, rig, layout=LAYOUT)
    return [finding.text for finding in find_people(inputs, SimpleNamespace(result=result))]


def findings_of(people, rig, person="consistent", *, layout=LAYOUT, fps=None):
    """Return the sentences of all findings of a run with ``person`` among people (T, M, P, N, 3)."""
    index, unmatched, crowd = picked(people, rig, person, layout)
    detections = take_people(people, index)
    frames = np.arange(len(detections))
    inputs = Inputs(rig, layout, detections, unmatched, frames, person=person, crowd=crowd, fps=fps)
    if fps is None:
        result = sk.refine(None, detections, rig, layout=layout)
    else:
        result = sk.refine_sequence(detections, rig, fps=fps, layout=layout)
    outcome = Outcome.of(result, sk.RefineConfig(), inputs)
    frames = joint_frames(inputs, outcome, np.asarray(result.joint_status))
    found = find_findings(inputs, outcome, summarise(inputs, outcome), frames)
    return [finding.text for finding in found]
