"""The page of a calibration without a board: cameras with error ellipsoids in 3D, and what pairs explain."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array, ArrayFields
from skelsplat._start import off_lines, rays_of
from skelsplat._words import length, listed, number
from skelsplat.run import tables
from skelsplat.run._run import in_order
from skelsplat.run.angles import world_up
from skelsplat.run.figures import skeleton_of
from skelsplat.run.html import camera_shapes, sentences, shown
from skelsplat.viz import report as page

if TYPE_CHECKING:
    from skelsplat.run.calibrate import Calibrated

# Frames that the page plays, and from which pairs are judged.
_PLAYED = 300
_JUDGED = 3000
_SCALES = {
    "adults": "a stature of 1.70 ± 0.09 m is assumed",
    "stature": "from the stature",
    "distance": "from the distance of two cameras",
}
# Distances explained by noise, in multiples of it, as in the core; and the median length of an error in two
# dimensions with a standard deviation of 1 along each.
_WITHIN = 4.0
_MEDIAN = 1.1774
_EXPLAINED = (
    "Explained: joints that both cameras see, within four times the noise of their epipolar lines in the rig "
    "that was found. Grey: a camera that was left out, or no joints."
)


@dataclass(frozen=True)
class Pairs(ArrayFields):
    """What M cameras show of each other; NaN of a camera and itself, and where nothing can be said."""

    shared: Array  # (M, M) joints that both see at the same time
    distance_px: Array  # (M, M) median distance of these from their epipolar lines
    explained: Array  # (M, M) the part of them within four times the noise

    @classmethod
    def of(cls, found: Calibrated) -> Pairs:
        """Compare the cameras of a calibration."""
        report, rig = found.found.report, found.found.cameras
        seen = np.concatenate(list(found.in_step()))[..., :2]  # (T, M, N, 2)
        there = np.isfinite(seen).all(axis=3).swapaxes(0, 1).reshape(len(report), -1).astype(float)
        shared = there @ there.T
        np.fill_diagonal(shared, np.nan)
        distance, explained = (np.full(shared.shape, np.nan) for _ in range(2))
        placed = [i for i, one in enumerate(report) if one.status == "placed"]
        some = np.linspace(0, len(seen) - 1, min(len(seen), _JUDGED)).astype(int)
        rays = rays_of(seen[some][:, placed], list(rig))
        noise = np.median([report[i].error for i in placed]) / _MEDIAN
        for (a, i), (b, j) in combinations(enumerate(placed), 2):
            one, other = rig[a], rig[b]
            R = np.asarray(other.R) @ np.asarray(one.R).T
            off = np.sqrt(off_lines(rays[:, a], rays[:, b], R, np.asarray(other.t) - R @ np.asarray(one.t)))
            off = off[np.isfinite(off)]
            if len(off):
                off *= np.sqrt(np.asarray(one.K)[0, 0] * np.asarray(other.K)[0, 0])
                distance[[i, j], [j, i]] = np.median(off)
                explained[[i, j], [j, i]] = (off < _WITHIN * noise).mean()
        return cls(shared, distance, explained)


def page_of(found: Calibrated, facts: Sequence[tuple[str, str]]) -> page.ReportData:
    """Return what the page shows; ``facts`` are further names and values for its head."""
    names = [one.name for one in found.found.report]
    recordings = listed([one.path.name for one in found.recordings])
    pairs, report = Pairs.of(found), found.found.report
    covariances = np.stack([one.place_covariance for one in report if one.status == "placed"])
    return page.ReportData(
        title=f"SkelSplat: cameras found from {recordings}",
        facts=[*_facts(found), *facts, ("skelsplat", sk.__version__)],
        warnings=sentences(in_order(found.findings)),
        notes=[*(one.text for one in found.findings if one.severity == "note"), *_notes(found)],
        numbers=list(_numbers(found)),
        problems=None,
        heading="The cameras in 3D",
        sequence=_sequence(found),
        shapes=camera_shapes(found.found.cameras, covariances),
        tables=shown(tables.of_calibrated(found)),
        lines=[],
        heat=page.HeatMap(
            "Pairs of cameras",
            names,
            names,
            [
                page.Heat("explained", "%", "%{z:.0f}% explained", 100 * pairs.explained, 100.0),
                page.Heat("distance from the epipolar lines", "px", "median %{z:.1f} px", pairs.distance_px),
                page.Heat("joints that both see", "joints", "%{z:,.0f} joints", pairs.shared),
            ],
            _EXPLAINED,
        ),
    )


def _facts(found: Calibrated) -> Iterator[tuple[str, str]]:
    yield "detections", ", ".join(str(one.path) for one in found.recordings)
    yield "layout", f"{found.layout.name}, {len(found.layout.joints)} joints"
    yield "frames", f"{sum(one.frames for one in found.recordings):,}"
    yield "focal lengths", "found" if found.focal else "as given"


def _numbers(found: Calibrated) -> Iterator[tuple[str, str, str]]:
    """Yield the key numbers: name, value and remark."""
    result = found.found
    placed = [one for one in result.report if one.status == "placed"]
    left = [one.name for one in result.report if one.status != "placed"]
    turn, place = (max(getattr(one, name) for one in placed) for name in ("turn_sigma", "place_sigma"))
    verdict = f"the recording {'tells' if result.sure else 'does not tell'} their places"
    remark = f"without {listed(left)}; {verdict}" if left else verdict
    yield "cameras placed", f"{len(placed)} of {len(result.report)}", remark
    yield "largest turn ±", f"{length(turn)}°", "above 3° nothing is written"
    yield "largest place ±", f"{length(place, 0)} mm", "above 6% of the camera's distance nothing is written"
    yield ("joints ±", f"{length(result.cameras.joint_sigma)} mm", "by the cameras, in error bars of poses")
    yield "lengths ±", f"{number(100 * result.scale_sigma)}%", _SCALES[found.scale]
    known = np.isfinite(result.up_sigma)
    up = "standard error of the vertical, z" if known else "z is not up: nobody was seen to stand"
    yield "up ±", f"{number(result.up_sigma)}°" if known else "–", up


def _notes(found: Calibrated) -> Iterator[str]:
    count = len(found.found.people)
    who = "a person" if count == 1 else f"{count} people"
    yield (
        "Error bars are standard deviations with the rig aligned as a whole; those of turns and places are "
        "root-mean-square lengths. Ellipsoids are cut off at 2 m before they are enlarged."
    )
    yield (
        f"The joints of {who} are triangulated with the cameras that were found, in at most {_PLAYED} "
        "frames, and not refined: they have no error bars."
    )


def _sequence(found: Calibrated) -> page.Sequence3D:
    """Return the joints of everybody in some frames, as the cameras show them."""
    result, names = found.found, found.layout.joints
    floor = bool(np.isfinite(result.up_sigma))
    some = np.linspace(0, len(found.frames) - 1, min(len(found.frames), _PLAYED)).astype(int)
    placed = [i for i, one in enumerate(result.report) if one.status == "placed"]
    joints = [sk.triangulate(one[some][:, placed], result.cameras) for one in found.in_step()]
    people = [f"person {k}" for k in range(len(joints))] if len(joints) > 1 else []
    every = np.concatenate(joints, axis=1)
    return page.Sequence3D(
        start=None,
        refined=every,
        error_bar=np.full((*every.shape, 3), np.nan),
        status=np.full(every.shape[:2], "ok"),
        frames=found.frames[some],
        frame_rate=found.fps,
        joint_names=[f"{one}, {joint}" for one in people for joint in names] if people else names,
        skeleton=skeleton_of(found.layout),
        up=np.array([0.0, 0.0, 1.0]) if floor else world_up(result.cameras),
        floor_mm=0.0 if floor else None,
        start_name="",
        people=people,
    )
