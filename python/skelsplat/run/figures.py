"""What the figures show: one frame's poses, heat maps and joints, as arrays for `skelsplat.viz`."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import skelsplat as sk
from skelsplat import viz
from skelsplat._arrays import Array
from skelsplat._words import ordinal
from skelsplat.run._run import PeopleRun, Run
from skelsplat.run.angles import vertical_of, world_up
from skelsplat.run.summary import finite_median, frame_medians


def write_figures(run: Run, folder: Path) -> list[str]:
    """Write ``overview.png`` and ``weights.png``; return their names."""
    result, statistics, mm = run.result, run.statistics, run.cameras.mm_per_unit
    frame, views = most_moved_frame(statistics.moved_mm), range(len(run.cameras))
    skeleton, names = skeleton_of(run.layout), ["overview.png", "weights.png"]
    overview = viz.OverviewData(
        before=run.outcome.start * mm,
        after=np.asarray(result.pose) * mm,
        error_bar=np.asarray(result.error_bar) * mm**2,
        status=np.asarray(result.joint_status),
        up=world_up(run.cameras),
        up_known=vertical_of(run.cameras) is not None,
        frame=frame,
        start=run.outcome.start_name,
        error_before=statistics.error_before,
        error_after=statistics.error_after,
        camera_names=run.cameras.names,
        panels=[_camera_panel(run, view, frame) for view in views],
        caption=_caption(run, frame),
    )
    viz.write_overview(folder / names[0], overview, skeleton=skeleton)
    weights = viz.WeightData(
        weights=np.asarray(result.view_weights),
        frames=run.frames,
        camera_names=run.cameras.names,
        joint_names=run.layout.joints,
        rejected_below=sk.REJECTED_WEIGHT,
    )
    viz.write_weights(folder / names[1], weights)
    return names


def write_people_figure(run: PeopleRun, path: Path) -> None:
    """Draw the paths from above, who is there when, and everybody in one frame."""
    first, source = next(iter(run.people.values())), run.report["input"]["detections"]
    data = viz.PeopleData(
        people=tracks_of(run),
        camera_names=first.cameras.names,
        centres=np.array([camera.centre for camera in first.cameras]) * first.cameras.mm_per_unit,
        up=world_up(first.cameras),
        skeleton=skeleton_of(first.layout),
        title=count_of(run) if source is None else f"{Path(source).name}: {count_of(run)}",
    )
    viz.write_people(path, data)


def count_of(run: PeopleRun) -> str:
    """Return how many people there are, in words."""
    return "1 person" if len(run.people) == 1 else f"{len(run.people)} people"


def tracks_of(run: PeopleRun) -> list[viz.PersonTrack]:
    """Return everybody as arrays in mm."""
    return [_track(f"person {identity}", one) for identity, one in run.people.items()]


def _track(name: str, run: Run) -> viz.PersonTrack:
    mm, found, statistics = run.cameras.mm_per_unit, run.outcome.sequence, run.statistics
    used = np.isfinite(statistics.error_after)
    with np.errstate(invalid="ignore"):
        rejected = statistics.rejected.sum(axis=(1, 2)) / used.sum(axis=(1, 2))
    return viz.PersonTrack(
        name=name,
        frames=run.frames,
        start=(run.outcome.start if found is None else np.asarray(found.init_pose)) * mm,
        refined=run.poses.pose * mm,
        error_bar=run.poses.error_bar * mm**2,
        status=run.poses.joint_status,
        seen=np.any(used & ~statistics.rejected, axis=2),
        error_px=frame_medians(statistics.error_after),
        rejected=rejected,
    )


def skeleton_of(layout: sk.Layout) -> viz.Skeleton:
    """Return what `skelsplat.viz` draws of a layout."""
    return viz.Skeleton(limbs=tuple(layout.limbs), left_right=tuple(layout.left_right))


def most_moved_frame(moved_mm: Array) -> int:
    """Return the index of the frame whose median joint moved most; one stray joint cannot decide that.

    Of distances (T, N), NaN where there is none; frames with fewer joints than usual are left out.
    """
    median, known = frame_medians(moved_mm), np.isfinite(moved_mm).sum(axis=1)
    usual = np.median(known[known > 0]) if known.any() else 0
    return int(np.argmax(np.where(np.isfinite(median) & (known >= usual), median, -np.inf)))


def _caption(run: Run, frame: int) -> str:
    """Return which frame is drawn, and why."""
    statistics, every = run.statistics, run.inputs.every
    here, typical = finite_median(statistics.moved_mm[frame]), finite_median(statistics.moved_mm)
    digits = statistics.decimals if statistics.decimals > 1 else 0
    words = f"Frame {run.frames[frame]}"
    if np.isfinite(here):
        words += f", with the largest change: median joint {here:.{digits}f} mm from the "
        words += f"{run.outcome.start_name} (all frames: {typical:.{digits}f} mm)"
    return words + (f"; drawn is every {ordinal(every)} frame" if every else "")


def _seen(run: Run, view: int, frame: int) -> Array:
    """Return the detections that one camera contributes, (N, 3), in ideal pixels; NaN where it has none."""
    used = np.isfinite(run.result.reprojection_error[frame, view])
    seen = np.where(used[:, None], run.detections[frame, view], np.nan)
    if run.outcome.config.undistort:
        seen[:, :2] = run.cameras[view].undistort(seen[:, :2])
    return seen


def _camera_panel(run: Run, view: int, frame: int) -> viz.CameraPanel:
    camera, result = run.cameras[view], run.result
    projected, covariances = sk.project_gaussians(result.pose[frame], result.error_bar[frame], [camera])
    return viz.CameraPanel(
        name=run.cameras.names[view],
        size=camera.size,
        detections=_seen(run, view, frame)[:, :2],
        reprojection=np.asarray(projected)[0],
        covariances=np.asarray(covariances)[0],
        rejected=np.asarray(result.view_weights[frame, view] < sk.REJECTED_WEIGHT),
        swapped=np.asarray(result.swapped[frame, view]),
    )
