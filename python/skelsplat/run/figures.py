"""What the figures show: one frame's poses, heat maps and joints, as arrays for `skelsplat.viz`."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import skelsplat as sk
from skelsplat import viz
from skelsplat._arrays import Array
from skelsplat._words import ordinal
from skelsplat.run._run import PeopleRun, Run
from skelsplat.run.read import Inputs
from skelsplat.run.solve import Outcome
from skelsplat.run.summary import Statistics, finite_median, frame_medians
from skelsplat.run.vertical import vertical_known, world_up


def write_figures(run: Run, folder: Path) -> list[str]:
    """Write ``overview.png`` and ``weights.png``, and heat maps where the method draws any; return names."""
    inputs, outcome, statistics = run.inputs, run.outcome, run.statistics
    frame, views = most_moved_frame(statistics.moved_mm), range(len(inputs.rig))
    mm = inputs.rig.mm_per_unit
    data = viz.OverviewData(
        before=outcome.start * mm,
        after=np.asarray(outcome.result.pose) * mm,
        error_bar=np.asarray(outcome.result.error_bar) * mm**2,
        status=np.asarray(outcome.result.joint_status),
        up=world_up(inputs.rig),
        up_known=vertical_known(inputs.rig),
        frame=frame,
        start=outcome.start_name,
        error_before=statistics.error_before,
        error_after=statistics.error_after,
        camera_names=inputs.rig.names,
        panels=[_camera_panel(view, frame, inputs, outcome) for view in views],
        caption=_caption(frame, inputs, outcome, statistics),
    )
    skeleton = skeleton_of(inputs.layout)
    viz.write_overview(folder / "overview.png", data, skeleton=skeleton)
    weights = viz.WeightData(
        weights=np.asarray(outcome.result.view_weights),
        frames=inputs.frames,
        camera_names=inputs.rig.names,
        joint_names=inputs.layout.joints,
        rejected_below=sk.REJECTED_WEIGHT,
    )
    viz.write_weights(folder / "weights.png", weights)
    names = ["overview.png", "weights.png"]
    if outcome.config.method == "paper":
        rows = [_heatmap_row(view, frame, inputs, outcome, statistics) for view in views]
        what = "heat maps summed over the joints (white 0, dark 1 and more), cropped to the pose"
        caption = f"Frame {inputs.frames[frame]}: {what}"
        viz.write_heatmaps(folder / "heatmaps.png", rows, skeleton=skeleton, caption=caption)
        names.append("heatmaps.png")
    return names


def write_people_figure(run: PeopleRun, path: Path) -> None:
    """Draw the paths from above, who is there when, and everybody in one frame."""
    cameras, source = next(iter(run.people.values())).cameras, run.report["input"]["detections"]
    title = count_of(run) if source is None else f"{Path(source).name}: {count_of(run)}"
    data = viz.PeopleData(
        people=tracks_of(run),
        camera_names=cameras.names,
        centres=np.array([camera.centre for camera in cameras]) * cameras.mm_per_unit,
        up=world_up(cameras),
        skeleton=skeleton_of(next(iter(run.people.values())).layout),
        title=title,
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

    Parameters
    ----------
    moved_mm : (T, N)
        Distance from the start to the refined pose; NaN where there is none. Frames in which fewer joints
        than usual have one are left out: a person who leaves the picture would decide.
    """
    median, known = frame_medians(moved_mm), np.isfinite(moved_mm).sum(axis=1)
    usual = np.median(known[known > 0]) if known.any() else 0
    return int(np.argmax(np.where(np.isfinite(median) & (known >= usual), median, -np.inf)))


def _caption(frame: int, inputs: Inputs, outcome: Outcome, statistics: Statistics) -> str:
    """Return which frame is drawn and why, and how many frames have joints that are not ok."""
    here, typical = finite_median(statistics.moved_mm[frame]), finite_median(statistics.moved_mm)
    count, status = len(inputs.frames), np.asarray(outcome.result.joint_status)
    start, digits = outcome.start_name, statistics.decimals if statistics.decimals > 1 else 0
    words, change = f"Frame {inputs.frames[frame]}", f"median joint {here:.{digits}f} mm from the {start}"
    if not np.isfinite(here):
        words += ", in which no joint can be compared with its start"
    elif count > 1:
        words += f", with the largest change: {change} (all frames: {typical:.{digits}f} mm)"
    else:
        words += f": {change}"
    frames = {name: int((status == name).any(axis=1).sum()) for name in ("inferred", "weak", "unobserved")}
    affected = ", ".join(f"{name} joints in {number}" for name, number in frames.items() if number)
    if inputs.thinned is not None:
        words += f"; drawn is every {ordinal(inputs.thinned.every)} frame"
    return f"{words}; {affected} of {count} frames" if affected else words


def _seen(view: int, frame: int, inputs: Inputs, outcome: Outcome) -> Array:
    """Return the detections that one camera contributes, (N, 3), in ideal pixels; NaN where it has none."""
    used = np.isfinite(outcome.result.reprojection_error[frame, view])
    seen = np.where(used[:, None], inputs.detections[frame, view], np.nan)
    if outcome.config.undistort:
        seen[:, :2] = inputs.rig[view].undistort(seen[:, :2])
    return seen


def _camera_panel(view: int, frame: int, inputs: Inputs, outcome: Outcome) -> viz.CameraPanel:
    camera, result = inputs.rig[view], outcome.result
    projected, covariances = sk.project_gaussians(result.pose[frame], result.error_bar[frame], [camera])
    return viz.CameraPanel(
        name=inputs.rig.names[view],
        size=camera.size,
        detections=_seen(view, frame, inputs, outcome)[:, :2],
        reprojection=np.asarray(projected)[0],
        covariances=np.asarray(covariances)[0],
        rejected=np.asarray(result.view_weights[frame, view] < sk.REJECTED_WEIGHT),
        swapped=np.asarray(result.swapped[frame, view]),
    )


def _heatmap_row(
    view: int, frame: int, inputs: Inputs, outcome: Outcome, statistics: Statistics
) -> viz.HeatmapRow:
    """Compute one camera's heat maps of one frame, in the pixels in which the renderer works (ideal ones)."""
    camera, result = inputs.rig[view], outcome.result
    pose, covariance = np.asarray(result.pose[frame]), np.asarray(result.covariance[frame])
    start = np.asarray(result.init_pose[frame])
    seen = _seen(view, frame, inputs, outcome)
    pseudo = np.zeros((camera.size[1], camera.size[0]), dtype=np.float32)
    rendering = np.zeros_like(pseudo)
    widths = initial_covariances(inputs, outcome.config)
    for j in np.flatnonzero(np.isfinite(seen[:, :2]).all(axis=1)):
        one = slice(j, j + 1)  # joint by joint: all images at once would take hundreds of megabytes
        pseudo += sk.pseudo_ground_truth(seen[one], start[one], widths[one], camera)[0]
        rendering += sk.render(pose[one], covariance[one], camera)[0]
    projected, _ = sk.project_gaussians(pose, covariance, [camera])
    return viz.HeatmapRow(
        name=inputs.rig.names[view],
        pseudo=pseudo,
        rendering=rendering,
        detections=seen[:, :2],
        reprojection=np.asarray(projected)[0],
        median_error_px=finite_median(statistics.error_after[frame, view]),
    )


def initial_covariances(inputs: Inputs, config: sk.RefineConfig) -> Array:
    """Return the covariances (N, 3, 3) that the splats start with, in the rig's unit squared."""
    sigma_mm = np.full(inputs.layout.n_joints, config.sigma_mm)
    if config.occlusion_sigma_mm is not None:
        sigma_mm[list(inputs.layout.occlusion_prone)] = config.occlusion_sigma_mm
    sigma = sigma_mm / inputs.rig.mm_per_unit
    return sigma[:, None, None] ** 2 * np.eye(3)
