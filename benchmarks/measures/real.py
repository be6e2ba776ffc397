"""Real detections: MVOR, an operating room, partly occluded people, three views; the package's recording."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from lab import Table
from numpy.typing import NDArray
from recordings import METHODS, Take
from scenarios import FloatArray, Scene, Stills, missing, mvor_stills
from scenarios import mvor as mvor_scene

import skelsplat as sk
from skelsplat.association import choose_person
from skelsplat.evaluation.baselines import affinity
from skelsplat.io import read_calibration, read_detections, sample

GROSS_MM = 150.0
GATE_MM = 500.0  # mean joint distance of an estimate from the person it is matched to
NEAR_PX = 5.0  # joints of a detection may lie so far outside the box of its person
INSIDE = 0.7  # share of a detection's joints that lie in the box of its person
DETECTORS = ("openpose", "openpose_ms", "rtpose")
PREDICT = ("frames", "sequence")  # methods that predict a camera

Everybody = list[list[tuple[FloatArray, NDArray[np.int64] | None]]]
"""Per frame the poses (17, 3) of people, and which detection of each view (3,) they are made of."""


def mvor() -> Table:
    """Mean, median, 90th percentile and share of gross errors."""
    here = mvor_scene()
    names = ("dlt-confidence", "ransac-iskakov", "ransac-adafuse", "cauchy")
    found = {"dlt": here.dlt(), **{name: here.solved(name) for name in names}}
    config = sk.RefineConfig.paper()
    found["paper, from dlt-confidence"] = here.refined(found["dlt-confidence"], config).pose
    found["default"] = here.refined().pose
    people = f"{len(here.truth)} people; {here.source}"
    notes = [*missing(found, here, "MVOR"), "labels are good to about ±50 mm", people]
    rows = {}
    for name, pose in found.items():
        each = sk.metrics.mpjpe(pose, here.judged, reduce="none")
        known = each[np.isfinite(each)]
        rows[name] = quantiles(known) | {f"> {GROSS_MM:.0f} mm, %": float(100 * (known > GROSS_MM).mean())}
    return Table.of("MVOR, mm", "method", rows, notes)


def quantiles(errors: FloatArray) -> dict[str, float]:
    """Return mean, median and 90th percentile."""
    median, most = np.percentile(errors, [50, 90]).tolist()
    return {"mean": float(errors.mean()), "median": median, "90 %": most}


def mvor_people() -> Table:
    """Measure how many people are found on MVOR, still by still, and their errors with and without an oracle.

    Precision counts who is near a labelled person. People without a label in space may still have boxes in
    the images: "mixed" are those nobody labelled is near who have detections of two people, one of each.
    mm: joints that two views detect of people found; oracle: the same, solved from their own detections.
    """
    rows = {}
    for detector in DETECTORS:
        stills = mvor_stills(detector)
        known = _oracle(stills)
        rows[f"{detector}, track"] = _scores(stills, _tracked(stills), known)
        found: Everybody = [
            [(pose, None) for pose in frame] for frame in affinity.found(stills.people, stills.cameras)
        ]
        rows[f"{detector}, affinity"] = _scores(stills, found, known)
    return Table.of("MVOR, several people", "detector, method", rows)


def leave_one_out() -> Table:
    """Predict each camera of the demo from the others: distances to what OpenPose detected there, px.

    `skelsplat.adjust_cameras` has set cam_03 right. Errors are those where all methods predict, and contain
    those of the detections and of the calibration: the differences count, not the level.
    """
    scene, rows = _recording(), {}
    found = sk.adjust_cameras(scene.detections, scene.rig, free=["cam_03"])
    for view, camera in enumerate(found.cameras):
        others = [i for i in range(len(scene.rig)) if i != view]
        rig = sk.CameraRig([found.cameras[i] for i in others], unit=scene.rig.unit)
        rest = replace(scene, rig=rig, detections=scene.detections[:, others])
        take, own = Take("", rest, sample.FRAME_RATE_HZ), scene.detections[:, view]
        seen = np.where(own[..., 2:] > 0, own[..., :2], np.nan)
        pixels = {name: sk.project(METHODS[name](take).pose, [camera])[0] for name in PREDICT}
        errors = {name: np.linalg.norm(found - seen, axis=-1) for name, found in pixels.items()}
        by_all = np.isfinite(list(errors.values())).all(axis=0)
        for name, error in errors.items():
            rows[f"{camera.name}, {name}"] = quantiles(error[by_all])
    return Table.of(f"{scene.source}, px", "predicted from the others", rows)


def _recording() -> Scene:
    """Read the balancing person: 100 frames, 25 joints, no truth."""
    with tempfile.TemporaryDirectory() as folder:
        paths = sample.extract(Path(folder))
        rig = read_calibration(paths.calibration, unit=sample.UNIT)
        found = read_detections(paths.detections, rig, layout=sample.LAYOUT)
    detections, _ = choose_person(found.people, rig)
    unknown = np.full((len(detections), detections.shape[2], 3), np.nan)
    return Scene(unknown, detections, rig, sample.LAYOUT, "real detections: OpenPose, Pose2Sim's demo")


def _oracle(stills: Stills) -> FloatArray:
    """Poses (7, F, 17, 3) of labelled people from their own detections: joints that two views detect."""
    frame, person, detections = stills.seen()
    out = np.full((*stills.match.shape[:2], 17, 3), np.nan)
    pose = sk.refine(None, detections, stills.cameras, layout="coco17").pose
    pose[(detections[..., 2] > 0).sum(axis=1) < 2] = np.nan
    out[frame, person] = pose
    return out.swapaxes(0, 1)


def _tracked(stills: Stills) -> Everybody:
    """Run `sk.track` on every frame by itself."""
    frames = [sk.track(frame[None], stills.cameras, fps=1.0, layout="coco17") for frame in stills.people]
    return [[(one.refinement.pose[0], one.slots[0]) for one in frame] for frame in frames]


def _scores(stills: Stills, found: Everybody, known: FloatArray) -> dict[str, float | int | None]:
    tracks = [(k, [f], pose[None]) for f, frame in enumerate(found) for k, (pose, _) in enumerate(frame)]
    truth = stills.truth.swapaxes(0, 1)
    every = sk.metrics.track_scores(tracks, truth, gate_mm=GATE_MM)
    optional = ((stills.match >= 0).sum(axis=-1) < 2).T
    judged = sk.metrics.track_scores(tracks, truth, optional=optional, gate_mm=GATE_MM)
    person, frame = np.nonzero((judged.matched >= 0) & ~optional)
    own = np.array([found[f][k][0] for f, k in zip(frame, judged.matched[person, frame], strict=True)])
    error, least = (
        np.linalg.norm(pose - truth[person, frame], axis=-1) for pose in (own, known[person, frame])
    )
    both = np.isfinite(error) & np.isfinite(least)
    mixed, total = _mixed(stills, found, every.matched), sum(map(len, found))
    return {
        "people": total,
        "recall %": 100 * judged.recall,
        "precision %": 100 * every.precision,
        "mixed %": None if mixed is None else 100 * mixed / total,
        "mean mm": float(error[both].mean()),
        "oracle": float(least[both].mean()),
    }


def _mixed(stills: Stills, found: Everybody, matched: NDArray[np.int64]) -> int | None:
    """Count estimates near nobody labelled with detections of two people, one of each; None if unknown."""
    count, known = 0, False
    for f, frame in enumerate(found):
        near = set(matched[:, f].tolist())
        for slots in (slots for k, (_, slots) in enumerate(frame) if k not in near and slots is not None):
            boxed = [_boxed(stills, f, view, slot) for view, slot in enumerate(slots) if slot >= 0]
            people = [one for one in boxed if one is not None]
            count += len(people) == len(set(people)) > 1
            known = True
    return count if known else None


def _boxed(stills: Stills, frame: int, view: int, slot: int) -> int | None:
    """Return the labelled person whose box contains most of a detection's joints, the best if several do."""
    matched = np.flatnonzero(stills.match[frame, :, view] == slot)
    if len(matched):
        return int(matched[0])
    joints = stills.people[frame, view, slot]
    pixels = joints[joints[:, 2] > 0, :2]
    low, high = stills.boxes[frame, view, :, None, :2], stills.boxes[frame, view, :, None, 2:]
    inside = ((pixels >= low - NEAR_PX) & (pixels <= high + NEAR_PX)).all(axis=-1).mean(axis=-1)
    extent = np.concatenate([pixels.min(axis=0), pixels.max(axis=0)])
    fit = np.where(inside >= INSIDE, _overlap(stills.boxes[frame, view], extent), -1.0)
    return int(fit.argmax()) if fit.max() > 0 else None


def _overlap(boxes: FloatArray, box: FloatArray) -> FloatArray:
    """Return intersection over union of boxes (G, 4) with one; 0 where there is none."""
    sides = np.minimum(boxes[:, 2:], box[2:]) - np.maximum(boxes[:, :2], box[:2])
    common = np.nan_to_num(np.maximum(sides, 0.0)).prod(axis=-1)
    union = (boxes[:, 2:] - boxes[:, :2]).prod(axis=-1) + (box[2:] - box[:2]).prod() - common
    return np.nan_to_num(common / union)
