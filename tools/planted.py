"""The faults that `tools/faults.py` plants."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Fault:
    """A fault: its description and kind, the text that it replaces, and the tests expected to find it.

    A finder is a test file, or arguments of ``cargo test`` for the core's own tests.
    """

    name: str
    kind: str
    old: str
    new: str
    finders: tuple[str, ...]


UNIT = "tests/unit/"

CORE = (
    Fault(
        "the depth term of the gradient has the wrong sign",
        "sign in a gradient",
        "-(g.x * p.x + g.y * p.y) / p.z",
        "(g.x * p.x + g.y * p.y) / p.z",
        ("cargo --test gradients",),
    ),
    Fault(
        "the closed form's covariance gradient adds C⁻¹ r rᵀ C⁻¹ with the wrong sign",
        "sign in a gradient",
        "(inverse - total_inverse + pull * pull.transpose())",
        "(inverse - total_inverse - pull * pull.transpose())",
        ("cargo --test overlap",),
    ),
    Fault(
        "coupled limbs move their joints in the wrong direction (Woodbury's identity)",
        "sign in a solver",
        "self.steps[j] -= y * *push;",
        "self.steps[j] += y * *push;",
        ("cargo --test equations",),
    ),
    Fault(
        "the Jacobian of tangential distortion mixes x and y",
        "swapped index",
        "2.0 * p2 * x.x + 6.0 * p1 * x.y,",
        "2.0 * p2 * x.x + 6.0 * p1 * x.x,",
        ("cargo --test camera",),
    ),
    Fault(
        "swapping a pair of joints swaps a detection of another view",
        "swapped index",
        "self.rays.swap(a * self.n_views + i, b * self.n_views + i);",
        "self.rays.swap(a * self.n_views + i, b * self.n_views);",
        ("tests/parity/test_annealed.py", UNIT + "test_refine.py", UNIT + "test_cli_report.py"),
    ),
    Fault(
        "a ray's weight omits the detection's confidence",
        "dropped confidence",
        "weight: confidence * view_weight,",
        "weight: view_weight + 0.0 * confidence,",
        ("tests/parity/test_annealed.py", UNIT + "test_confidence.py"),
    ),
    Fault(
        "a centimetre is converted to 100 mm",
        "wrong unit",
        "Self::Centimetre => 10.0,",
        "Self::Centimetre => 100.0,",
        (UNIT + "test_invariance.py", UNIT + "test_refine.py"),
    ),
    Fault(
        "the learning-rate decay counts steps from one",
        "off by one",
        "self.initial * self.decay.powf(t / self.steps)",
        "self.initial * self.decay.powf((t + 1.0) / self.steps)",
        ("cargo --lib",),
    ),
    Fault(
        "the window of the stopping rule is one step too long",
        "off by one",
        "if self.count < self.window {",
        "if self.count <= self.window {",
        ("cargo --lib",),
    ),
    Fault(
        "lens distortion is not removed from the detections",
        "dropped undistortion",
        "if self.config.undistort { kept.undistorted(&self.cameras) } else { kept }",
        "if self.config.undistort && false { kept.undistorted(&self.cameras) } else { kept }",
        (UNIT + "test_refine.py", UNIT + "test_invariance.py"),
    ),
    Fault(
        "the margin of the field of view is doubled",
        "wrong constant",
        "const FIELD_OF_VIEW_MARGIN: f64 = 0.15;",
        "const FIELD_OF_VIEW_MARGIN: f64 = 0.30;",
        ("tests/parity/test_projection.py",),
    ),
    Fault(
        "the default tolerance for limb symmetry is half as large again",
        "wrong default",
        "pub const SYMMETRY_SIGMA: f64 = 15.0;",
        "pub const SYMMETRY_SIGMA: f64 = 22.0;",
        (UNIT + "test_config.py", "tests/parity/test_annealed.py"),
    ),
    Fault(
        "error bars count rejected detections fully",
        "wrong covariance",
        "(ray.weight * k / variance)",
        "(ray.weight * (1.0 + 0.0 * k) / variance)",
        ("tests/parity/test_annealed.py", UNIT + "test_reliability.py"),
    ),
    Fault(
        "a joint of undetermined depth has status ok",
        "wrong status",
        "_ if !deep[j] => JointStatus::Weak,",
        "_ if !deep[j] => JointStatus::Ok,",
        ("cargo --test annealed",),
    ),
    Fault(
        "a batch on several threads returns its frames in reverse order",
        "threads",
        "frames.par_iter().zip(parts).map(|job| refine_into(job, false)).collect();",
        "frames.par_iter().rev().zip(parts).map(|job| refine_into(job, false)).collect();",
        ("cargo --test determinism",),
    ),
    Fault(
        "the parent's thread pool is used after a fork",
        "threads",
        "kept.as_ref().filter(|k| k.process == process)",
        "kept.as_ref().filter(|k| k.process > 0)",
        (UNIT + "test_processes.py",),
    ),
    Fault(
        "short calls do not release the interpreter",
        "interpreter not released",
        "return Ok(py.detach(|| work(&Progress::default()))?);",
        "return Ok(work(&Progress::default())?);",
        (UNIT + "test_threads.py",),
    ),
    Fault(
        "after Ctrl-C the work continues in its thread",
        "lost cancellation",
        "            progress.cancel();\n            return Err(stop.into());",
        "            return Err(stop.into());",
        (UNIT + "test_interrupt.py",),
    ),
)

READERS = (
    Fault(
        "a camera's frame offset is added instead of subtracted",
        "sign of an offset",
        "own = numbers - self._whole",
        "own = numbers + self._whole",
        (UNIT + "test_detections.py",),
    ),
    Fault(
        "the frame number is the first integer in a file name instead of the last",
        "off by one in a reader",
        'frame_number(path, "file name", digits[-1])',
        'frame_number(path, "file name", digits[0])',
        (UNIT + "test_detections.py", UNIT + "test_openpose.py"),
    ),
    Fault(
        "cameras are in the order of the folders, not of the calibration",
        "order of cameras",
        "views = [read.get(name, []) for name in self.camera_names]",
        "views = [read.get(name, []) for name in sorted(self.camera_names)]",
        (UNIT + "test_detections.py", UNIT + "test_detections_matching.py"),
    ),
    Fault(
        "Panoptic's centimetres are read as millimetres",
        "wrong unit",
        'for entry in chosen], "cm")',
        'for entry in chosen], "mm")',
        (UNIT + "test_calibration_formats.py", UNIT + "test_calibration.py"),
    ),
)

POSE_FILES = (
    Fault(
        "a file is written in place, so that an interruption leaves half of it",
        "half-written file",
        'with atomic_path(path, ".tmp", durable=durable) as temporary, temporary.open("wb") as stream:',
        'with Path(path).open("wb") as stream:',
        (UNIT + "test_writers.py", UNIT + "test_pose_files.py"),
    ),
    Fault(
        "y-up rotates the axes in the wrong direction",
        "axis of a marker file",
        "Y_UP = [1, 2, 0]",
        "Y_UP = [2, 0, 1]",
        (UNIT + "test_pose_c3d.py", UNIT + "test_writers.py"),
    ),
    Fault(
        "C3D coordinates stay in the rig's unit but are labelled mm",
        "wrong unit",
        "    position = data.pose * MM_PER_UNIT[data.unit]\n",
        "    position = data.pose\n",
        (UNIT + "test_pose_c3d.py",),
    ),
    Fault(
        "a C3D file starts one frame late",
        "off by one",
        "= int(data.frames[0]) + shift - 1",
        "= int(data.frames[0]) + shift",
        (UNIT + "test_pose_c3d.py",),
    ),
    Fault(
        "TRC rows are numbered from zero",
        "off by one",
        '[str(step + 1), f"{step / rate:.6f}", *fields, ""]',
        '[str(step), f"{step / rate:.6f}", *fields, ""]',
        (UNIT + "test_writers.py", UNIT + "test_trc_readers.py"),
    ),
    Fault(
        "CSV contains variances instead of standard deviations",
        "covariance not scaled",
        "deviations = np.sqrt(np.concatenate([np",
        "deviations = np.array(np.concatenate([np",
        (UNIT + "test_pose_files.py", UNIT + "test_writers.py"),
    ),
)

ANALYSIS = (
    Fault(
        "the Butterworth cutoff is not corrected for two passes",
        "filter with the wrong cutoff",
        "angle = math.tan(math.pi * cutoff / frame_rate) / (math.sqrt(2.0) - 1.0) ** (1.0 / (2 * order))",
        "angle = math.tan(math.pi * cutoff / frame_rate)",
        (UNIT + "test_temporal.py",),
    ),
    Fault(
        "gaps one frame too long are filled",
        "off by one",
        "numbers[after] - numbers[before] - 1 <= max_gap",
        "numbers[after] - numbers[before] - 2 <= max_gap",
        (UNIT + "test_temporal.py",),
    ),
    Fault(
        "methods over time smooth across gaps in the frame numbers",
        "lost check",
        "np.flatnonzero(np.diff(frames) != 1)",
        "np.flatnonzero(np.diff(frames) < 1)",
        (UNIT + "evaluation/test_methods.py",),
    ),
    Fault(
        "the alignment of PA-MPJPE allows reflections",
        "wrong metric",
        "np.where(np.linalg.det(u @ vt) < 0, -1.0, 1.0)",
        "np.where(np.linalg.det(u @ vt) < 0, 1.0, 1.0)",
        (UNIT + "test_metrics.py",),
    ),
    Fault(
        "PCK ignores joints without a prediction",
        "wrong metric",
        "return result(_correct(errors <= threshold_mm, present(truth)), reduce)",
        "return result(_correct(errors <= threshold_mm, present(truth) & present(predicted)), reduce)",
        (UNIT + "test_metrics.py",),
    ),
    Fault(
        "the bootstrap does not weight takes by their number of frames",
        "wrong statistics",
        "means = (times @ total[used]) / (times @ number[used])",
        "means = (times @ (total[used] / number[used])) / n",
        (UNIT + "evaluation/test_scores.py",),
    ),
    Fault(
        "Human3.6M is evaluated on every 32nd frame instead of every 64th",
        "wrong protocol",
        '    subjects=("S9", "S11"),\n    every=64,',
        '    subjects=("S9", "S11"),\n    every=32,',
        (UNIT + "evaluation/test_protocols.py",),
    ),
    Fault(
        "a camera without detections is not reported",
        "lost finding",
        "findings.append(blind)",
        "pass",
        (UNIT + "test_rig_check.py",),
    ),
    Fault(
        "following a person does not consider left–right swaps",
        "lost hypothesis",
        "if mirrored && !figures.has_sides {",
        "if mirrored {",
        (UNIT + "test_association.py",),
    ),
)

FRONT = (
    Fault(
        "check-cameras exits with 0 despite findings",
        "wrong exit code",
        "    if not found.report.ok:\n        raise typer.Exit(1)",
        "    if not found.report.ok:\n        raise typer.Exit(0)",
        (UNIT + "test_cli_cameras.py",),
    ),
    Fault(
        "an error from the operating system does not name the file",
        "broken message",
        "return f\"{error.filename}: {(error.strerror or 'cannot be used').lower()}\"",
        "return f\"{(error.strerror or 'cannot be used').lower()}\"",
        (UNIT + "test_cli.py",),
    ),
    Fault(
        "the HTML report contains no curves",
        "HTML without data",
        '"lines": [line.packed(places) for line in data.lines],',
        '"lines": [],',
        (UNIT + "test_html_report.py", UNIT + "test_report_browser.py"),
    ),
    Fault(
        "the colours of left and right are swapped in the report",
        "swapped colours",
        "_SIDES = {_style.LEFT: 0, _style.RIGHT: 1, _style.MIDDLE: 2}",
        "_SIDES = {_style.LEFT: 1, _style.RIGHT: 0, _style.MIDDLE: 2}",
        (UNIT + "test_report_browser.py",),
    ),
)

# Close to what only the sweeps test, and to figures that the suite does not draw.
LEFT_OUT = (
    Fault(
        "a rig fault must explain twice as much to be reported",
        "lost finding",
        "_ALL_BETTER = 0.85\n_ITSELF_BETTER = 0.7",
        "_ALL_BETTER = 0.4\n_ITSELF_BETTER = 0.3",
        (UNIT + "test_rig_check_causes.py",),
    ),
    Fault(
        "cameras rearranged since calibration are reported as rotated or moved one by one",
        "wrong finding",
        "_FAR_DEG = 2.5\n_FAR_MM = 150.0",
        "_FAR_DEG = 25.0\n_FAR_MM = 1500.0",
        (UNIT + "test_rig_check.py",),
    ),
    Fault(
        "swapped cameras are only searched in pairs",
        "lost hypothesis",
        "yield from list(permutations(range(count)))[1:]",
        "yield from (o for o in permutations(range(count)) if sum(i != k for i, k in enumerate(o)) == 2)",
        (UNIT + "test_rig_check_files.py",),
    ),
    Fault(
        "Huber's loss weights outliers by the inverse square of their distance",
        "wrong derivative",
        "return np.where(inside, s, 2.0 * root - 1.0), 1.0 / root, inside.astype(np.float64)",
        "return np.where(inside, s, 2.0 * root - 1.0), 1.0 / root**2, inside.astype(np.float64)",
        (UNIT + "test_robust_minimum.py",),
    ),
    Fault(
        "figures are saved at half their size",
        "wrong picture",
        'figure.savefig(stream, format="png", dpi=figure.dpi,',
        'figure.savefig(stream, format="png", dpi=figure.dpi / 2,',
        (UNIT + "test_viz.py", UNIT + "test_viz_print.py"),
    ),
    Fault(
        "the overview compares distorted detections with ideal reprojections",
        "dropped undistortion",
        "        seen[:, :2] = inputs.rig[view].undistort(seen[:, :2])\n",
        "        pass\n",
        (UNIT + "test_run_figures.py",),
    ),
)

# Planted before the suite was shortened, where users would be wrong without an error.
SILENT = (
    Fault(
        "the process noise of the live filter's position is half as large again",
        "wrong covariance",
        "(q * dt.powi(3) / 3.0)",
        "(q * dt.powi(3) / 2.0)",
        ("cargo --test live",),
    ),
    Fault(
        "with a lag the live answer is a frame late",
        "off by one",
        "checked_sub(self.lag + 1)",
        "checked_sub(self.lag + 2)",
        (UNIT + "test_live_rate.py", "cargo --test live"),
    ),
    Fault(
        "a camera's turn has the wrong sign in the bundle adjustment",
        "sign in a gradient",
        "let turn = -by_point * rotation.tr_mul",
        "let turn = by_point * rotation.tr_mul",
        ("cargo --test rig",),
    ),
    Fault(
        "error bars over time hide the other place on a ray",
        "wrong covariance",
        "self.posterior.positions[k] + self.undecided(j, t, alone)",
        "self.posterior.positions[k]",
        ("cargo --test sequence", UNIT + "test_sequence.py"),
    ),
    Fault(
        "inferred joints are allowed ten times as wide",
        "wrong status",
        "widest() <= INFERRED * common.reach",
        "widest() <= 10.0 * INFERRED * common.reach",
        ("cargo --test sequence", UNIT + "test_sequence.py"),
    ),
    Fault(
        "of several people those seen least are kept",
        "wrong order",
        "tracks.sort_by_key(|track| std::cmp::Reverse(track.figures()));",
        "tracks.sort_by_key(|track| track.figures());",
        (UNIT + "test_track.py",),
    ),
    Fault(
        "both ends of a direction move an angle the same way",
        "sign in a gradient",
        "+ sign / len(point) * gradient",
        "+ 1.0 / len(point) * gradient",
        (UNIT + "test_angles.py",),
    ),
    Fault(
        "abduction of left limbs has the sign of right ones",
        "sign of a side",
        "outward = (-90.0 * right, right)",
        "outward = (-90.0, 1.0)",
        (UNIT + "test_angles.py",),
    ),
    Fault(
        "filled joints keep an error bar",
        "wrong covariance",
        "uncertainty=np.where(filled[..., None, None], np.nan, data.uncertainty),",
        "uncertainty=data.uncertainty,",
        (UNIT + "test_cli_over_time.py",),
    ),
    Fault(
        "an initial pose in another unit is taken as it is",
        "wrong unit",
        "data.pose * (MM_PER_UNIT[data.unit] / rig.mm_per_unit)",
        "data.pose * 1.0",
        (UNIT + "test_cli.py",),
    ),
    Fault(
        "y up is a reflection",
        "wrong axes",
        "Y_UP = [1, 2, 0]",
        "Y_UP = [0, 2, 1]",
        (UNIT + "test_writers.py", UNIT + "test_pose_c3d.py"),
    ),
    Fault(
        "a batch skips a recording whose detections changed",
        "stale result",
        "            found.update(str(text).encode())\n",
        "            pass\n",
        (UNIT + "test_batch.py",),
    ),
    Fault(
        "reset does nothing for several people",
        "lost state",
        "        if line.reset:\n            tracker.reset()\n",
        "",
        (UNIT + "test_live_people.py",),
    ),
    Fault(
        "binned images have their centre half a pixel off",
        "off by half a pixel",
        "centre = (centre + 0.5) / binning - 0.5",
        "centre = centre / binning",
        (UNIT + "test_calibration_formats.py",),
    ),
    Fault(
        "error ellipses on videos ignore correlations between axes",
        "wrong picture",
        "jacobian, covariances, jacobian)",
        "jacobian, covariances * np.eye(3), jacobian)",
        (UNIT + "test_overlay_drawing.py", UNIT + "test_overlay_input.py"),
    ),
    Fault(
        "MediaPipe's y is scaled by the width",
        "wrong unit",
        "points * (image.shape[1], image.shape[0], 1.0)",
        "points * (image.shape[1], image.shape[1], 1.0)",
        (UNIT + "test_detect.py",),
    ),
    Fault(
        "truth in other units is not converted",
        "wrong unit",
        "MM_PER_UNIT[unit] * truth, given.path",
        "truth, given.path",
        (UNIT + "datasets/test_others.py",),
    ),
    Fault(
        "the first frames of every part of a long recording are drawn",
        "wrong sample",
        "np.arange(-place.start % self.every, place.stop - place.start, self.every)",
        "np.arange(0, place.stop - place.start, self.every)",
        (UNIT + "test_run_long.py",),
    ),
    Fault(
        "counts of a long recording miss its first part",
        "wrong statistics",
        "sum(getattr(part, name) for part in parts) for name in _COUNTS",
        "sum(getattr(part, name) for part in parts[1:]) for name in _COUNTS",
        (UNIT + "test_run_long.py",),
    ),
    Fault(
        "the person nearest to a point is the farthest",
        "wrong person",
        "nearest = min(away, key=lambda who: away[who])",
        "nearest = max(away, key=lambda who: away[who])",
        (UNIT + "test_tracked.py",),
    ),
)

FAULTS: tuple[Fault, ...] = (*CORE, *READERS, *POSE_FILES, *ANALYSIS, *FRONT, *LEFT_OUT, *SILENT)
