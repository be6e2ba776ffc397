"""The faults that `tools/faults.py` plants, as patches.

A patch has a line with what is wrong and the kind of fault, one with the tests expected to find it (files,
or arguments of ``cargo test`` for the core's own), and the text that is replaced (``-``) and that replaces it
(``+``). A text may begin and end within a line of its file.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass


@dataclass(frozen=True)
class Fault:
    """A fault: its description and kind, the text that it replaces, and the tests expected to find it."""

    name: str
    kind: str
    old: str
    new: str
    finders: tuple[str, ...]


def faults(patches: str) -> Iterator[Fault]:
    """Read patches, which blank lines separate."""
    for patch in patches.strip().split("\n\n"):
        about, finders, *lines = (line for line in patch.splitlines() if not line.startswith("#"))
        name, _, kind = about.partition(" | ")
        old, new = ("\n".join(line[1:] for line in lines if line[0] == mark) for mark in "-+")
        yield Fault(name, kind, old, new, tuple(finders.split(", ")))


_PATCHES = r"""
# The core.
the depth term of the gradient has the wrong sign | sign in a gradient
cargo --test suite gradients::
--(g.x * p.x + g.y * p.y) / p.z
+(g.x * p.x + g.y * p.y) / p.z

the closed form's covariance gradient adds C⁻¹ r rᵀ C⁻¹ with the wrong sign | sign in a gradient
cargo --test suite overlap::
-(inverse - total_inverse + pull * pull.transpose())
+(inverse - total_inverse - pull * pull.transpose())

coupled limbs move their joints in the wrong direction | sign in a solver
tests/parity/test_annealed.py, cargo --test suite annealed::
-set_lane(step, s % LANES, v - moves * *by);
+set_lane(step, s % LANES, v + moves * *by);

the Jacobian of tangential distortion mixes x and y | swapped index
cargo --test suite camera::
-2.0 * p2 * x.x + 6.0 * p1 * x.y,
+2.0 * p2 * x.x + 6.0 * p1 * x.x,

swapping a pair of joints swaps a detection of another view | swapped index
tests/unit/test_refine.py
-self.rays.swap(a * self.n_views + i, b * self.n_views + i);
+self.rays.swap(a * self.n_views + i, b * self.n_views);

a ray's weight omits the detection's confidence | dropped confidence
tests/parity/test_annealed.py, tests/unit/test_confidence.py
-weight: confidence * view_weight,
+weight: view_weight + 0.0 * confidence,

a centimetre is converted to 100 mm | wrong unit
tests/unit/test_invariance.py, tests/unit/test_refine.py
-Self::Centimetre => 10.0,
+Self::Centimetre => 100.0,

the learning-rate decay counts steps from one | off by one
cargo --test suite schedule::
-initial * decay.powf(t as f64 / steps)
+initial * decay.powf((t as f64 + 1.0) / steps)

the window of the stopping rule is one step too long | off by one
cargo --test suite schedule::
-if self.count < self.window {
+if self.count <= self.window {

lens distortion is not removed from the detections | dropped undistortion
tests/unit/test_refine.py, tests/unit/test_invariance.py
-if self.config.undistort { kept.undistorted(&self.cameras) } else { kept }
+if self.config.undistort && false { kept.undistorted(&self.cameras) } else { kept }

the margin of the field of view is doubled | wrong constant
tests/parity/test_projection.py
-const FIELD_OF_VIEW_MARGIN: f64 = 0.15;
+const FIELD_OF_VIEW_MARGIN: f64 = 0.30;

the default tolerance for limb symmetry is half as large again | wrong default
tests/unit/test_config.py, tests/parity/test_annealed.py
-pub const SYMMETRY_SIGMA: f64 = 15.0;
+pub const SYMMETRY_SIGMA: f64 = 22.0;

error bars count rejected detections fully | wrong covariance
tests/parity/test_annealed.py, tests/unit/test_reliability.py
-ray.weight * k / variance
+ray.weight * (1.0 + 0.0 * k) / variance

a joint of undetermined depth has status ok | wrong status
cargo --test suite annealed::
-_ if votes.agree[j] < 2 || !deep[j] => JointStatus::Weak,
+_ if votes.agree[j] < 2 => JointStatus::Weak,

a batch on several threads returns its frames in reverse order | threads
cargo --test suite determinism::
-chunk.par_iter().map(|frame| refine(frame, false)).collect();
+chunk.par_iter().rev().map(|frame| refine(frame, false)).collect();

the parent's thread pool is used after a fork | threads
tests/unit/test_threads.py
-kept.as_ref().filter(|k| k.process == process)
+kept.as_ref().filter(|k| k.process > 0)

short calls do not release the interpreter | interpreter not released
tests/unit/test_threads.py
-return Ok(py.detach(|| work(&Progress::default()))?);
+return Ok(work(&Progress::default())?);

after Ctrl-C the work continues in its thread | lost cancellation
tests/unit/test_interrupt.py
-            progress.cancel();
-            return Err(stop.into());
+            return Err(stop.into());

# Readers.
a camera's frame offset is added instead of subtracted | sign of an offset
tests/unit/test_detections.py
-return numbers - whole, np.full(len(numbers), -rest)
+return numbers + whole, np.full(len(numbers), -rest)

a camera's offset counts in frames of the recording | the wrong clock
tests/unit/test_frame_rates.py
-return near.astype(np.int64) + self.first - whole,
+return near.astype(np.int64) + self.first - round(whole * self.pace),

the frame number is the first integer in a file name instead of the last | off by one in a reader
tests/unit/test_detections.py, tests/unit/test_openpose.py
-frame_number(path, "file name", digits[-1])
+frame_number(path, "file name", digits[0])

cameras are in the order of the folders, not of the calibration | order of cameras
tests/unit/test_detections.py, tests/unit/test_detections_matching.py
-cameras = self.views.items()
+cameras = sorted(self.views.items())

Panoptic's centimetres are read as millimetres | wrong unit
tests/unit/test_calibration_formats.py, tests/unit/test_calibration.py
-for entry in chosen], "cm"
+for entry in chosen], "mm"

# Files of poses.
a file is written in place, so that an interruption leaves half of it | half-written file
tests/unit/test_pose_files.py
-with atomic_path(path, ".tmp", durable=durable) as temporary, temporary.open("wb") as stream:
+with Path(path).open("wb") as stream:

y-up rotates the axes in the wrong direction | axis of a marker file
tests/unit/test_pose_c3d.py, tests/unit/test_pose_trc.py
-Y_UP = [1, 2, 0]
+Y_UP = [2, 0, 1]

C3D coordinates stay in the rig's unit but are labelled mm | wrong unit
tests/unit/test_pose_c3d.py
-    position = data.pose * MM_PER_UNIT[data.unit]
+    position = data.pose

a C3D file starts one frame late | off by one
tests/unit/test_pose_c3d.py
-= int(data.frames[0]) + shift - 1
+= int(data.frames[0]) + shift

TRC rows are numbered from zero | off by one
tests/unit/test_pose_trc.py
-[str(step + 1), f"{step / rate:.6f}", *fields, ""]
+[str(step), f"{step / rate:.6f}", *fields, ""]

CSV contains variances instead of standard deviations | covariance not scaled
tests/unit/test_pose_files.py
-deviations = np.sqrt(np.concatenate([np
+deviations = np.array(np.concatenate([np

# Analysis.
the Butterworth cutoff is not corrected for two passes | filter with the wrong cutoff
tests/unit/test_temporal.py
-angle = math.tan(math.pi * cutoff / frame_rate) / (math.sqrt(2.0) - 1.0) ** (1.0 / (2 * order))
+angle = math.tan(math.pi * cutoff / frame_rate)

gaps one frame too long are filled | off by one
tests/unit/test_temporal.py
-numbers[after] - numbers[before] - 1 <= max_gap
+numbers[after] - numbers[before] - 2 <= max_gap

methods over time smooth across gaps in the frame numbers | lost check
tests/unit/evaluation/test_methods.py
-np.flatnonzero(np.diff(frames) != 1)
+np.flatnonzero(np.diff(frames) < 1)

the alignment of PA-MPJPE allows reflections | wrong metric
tests/unit/test_metrics.py
-np.where(np.linalg.det(u @ vt) < 0, -1.0, 1.0)
+np.where(np.linalg.det(u @ vt) < 0, 1.0, 1.0)

PCK ignores joints without a prediction | wrong metric
tests/unit/test_metrics.py
-return result(_correct(errors <= threshold_mm, present(truth)), reduce)
+return result(_correct(errors <= threshold_mm, present(truth) & present(predicted)), reduce)

the bootstrap does not weight takes by their number of frames | wrong statistics
tests/unit/evaluation/test_scores.py
-means = (times @ total[used]) / (times @ number[used])
+means = (times @ (total[used] / number[used])) / n

Human3.6M is evaluated on every 32nd frame instead of every 64th | wrong protocol
tests/unit/evaluation/test_scores.py
-    subjects=("S9", "S11"),
-    every=64,
+    subjects=("S9", "S11"),
+    every=32,

a camera without detections is not reported | lost finding
tests/unit/test_rig_check.py
-yield Finding("no_detections", subject=subject, sentence=f"{name} has no detections.")
+pass

following a person does not consider left–right swaps | lost hypothesis
tests/unit/test_association.py
-if mirror.is_empty() || straight > 0.6 {
+if straight > -1.0 {

# What users see.
check-cameras exits with 0 despite findings | wrong exit code
tests/unit/test_adjust_cameras_command.py
-partial(print_findings, warnings), status=0 if report.ok else 1)
+partial(print_findings, warnings), status=0)

an error from the operating system does not name the file | broken message
tests/unit/test_cli.py
-return f"{error.filename}: {(error.strerror or 'cannot be used').lower()}"
+return f"{(error.strerror or 'cannot be used').lower()}"

the HTML report contains no curves | HTML without data
tests/unit/test_html_report.py, tests/unit/test_report_browser.py
-"lines": [line.packed(places) for line in data.lines],
+"lines": [],

the colours of left and right are swapped in the report | swapped colours
tests/unit/test_html_report.py
-_SIDES = {_style.LEFT: 0, _style.RIGHT: 1, _style.MIDDLE: 2}
+_SIDES = {_style.LEFT: 1, _style.RIGHT: 0, _style.MIDDLE: 2}

# Close to what only the sweeps test, and to figures that the suite does not draw.
a rig fault must explain twice as much to be reported | lost finding
tests/unit/test_rig_check_causes.py
-_ALL_BETTER = 0.85
-_ITSELF_BETTER = 0.7
+_ALL_BETTER = 0.4
+_ITSELF_BETTER = 0.3

cameras rearranged since calibration are reported as rotated or moved one by one | wrong finding
tests/unit/test_rig_check.py
-_FAR_DEG = 2.5
-_FAR_MM = 150.0
+_FAR_DEG = 25.0
+_FAR_MM = 1500.0

swapped cameras are only searched in pairs | lost hypothesis
tests/unit/test_rig_check_causes.py
-yield from list(permutations(range(count)))[1:]
+yield from (o for o in permutations(range(count)) if sum(i != k for i, k in enumerate(o)) == 2)

Huber's loss weights outliers by the inverse square of their distance | wrong derivative
tests/unit/test_robust_minimum.py
-return np.where(inside, s, 2.0 * root - 1.0), 1.0 / root, inside.astype(np.float64)
+return np.where(inside, s, 2.0 * root - 1.0), 1.0 / root**2, inside.astype(np.float64)

figures are saved at half their size | wrong picture
tests/unit/test_viz.py, tests/unit/test_viz_print.py
-figure.savefig(stream, format="png", dpi=figure.dpi,
+figure.savefig(stream, format="png", dpi=figure.dpi / 2,

the overview compares distorted detections with ideal reprojections | dropped undistortion
tests/unit/test_run.py
-        seen[:, :2] = run.cameras[view].undistort(seen[:, :2])
+        pass

# Planted before the suite was shortened, where users would be wrong without an error.
the process noise of the live filter's position is half as large again | wrong covariance
cargo --test suite live::
-(q * dt.powi(3) / 3.0)
+(q * dt.powi(3) / 2.0)

with a lag the live answer is a frame late | off by one
tests/unit/test_live.py, cargo --test suite live::
-checked_sub(self.lag + 1)
+checked_sub(self.lag + 2)

a camera's turn has the wrong sign in the bundle adjustment | sign in a gradient
cargo --test suite rig::
-let turn = -by_point * rotation.tr_mul
+let turn = by_point * rotation.tr_mul

error bars over time hide the other place on a ray | wrong covariance
cargo --test suite sequence::, tests/unit/test_sequence.py
-self.undecided(j, t, before) + self.contradicted[k]
+self.contradicted[k]

inferred joints are allowed ten times as wide | wrong status
tests/unit/test_sequence.py
-let most = (INFERRED * common.reach).powi(2);
+let most = (10.0 * INFERRED * common.reach).powi(2);

of several people those seen least are kept | wrong order
tests/unit/test_track.py
-tracks.sort_by_key(|track| std::cmp::Reverse(track.figures()));
+tracks.sort_by_key(|track| track.figures());

both ends of a direction move an angle the same way | sign in a gradient
tests/unit/test_angles.py
-+ sign / len(point) * gradient
++ 1.0 / len(point) * gradient

abduction of left limbs has the sign of right ones | sign of a side
tests/unit/test_angles.py
-outward = (-90.0 * right, right)
+outward = (-90.0, 1.0)

filled joints keep an error bar | wrong covariance
tests/unit/test_cli_over_time.py
-uncertainty=np.where(filled[..., None, None], np.nan, data.uncertainty),
+uncertainty=data.uncertainty,

an initial pose in another unit is taken as it is | wrong unit
tests/unit/test_cli.py
-data.pose * (MM_PER_UNIT[data.unit] / rig.mm_per_unit)
+data.pose * 1.0

y up is a reflection | wrong axes
tests/unit/test_pose_trc.py, tests/unit/test_pose_c3d.py
-Y_UP = [1, 2, 0]
+Y_UP = [0, 2, 1]

a batch skips a recording whose detections changed | stale result
tests/unit/test_batch.py
-                    found.update(part)
+                    pass

reset does nothing for several people | lost state
tests/unit/test_live_people.py
-        if reset:
-            tracker.reset()

binned images have their centre half a pixel off | off by half a pixel
tests/unit/test_calibration_formats.py
-centre = (centre + 0.5) / binning - 0.5
+centre = centre / binning

error ellipses on videos ignore correlations between axes | wrong picture
tests/unit/test_overlay_command.py
-jacobian, covariances, jacobian)
+jacobian, covariances * np.eye(3), jacobian)

MediaPipe's y is scaled by the width | wrong unit
tests/unit/test_detect.py
-points * (image.shape[1], image.shape[0], 1.0)
+points * (image.shape[1], image.shape[1], 1.0)

truth in other units is not converted | wrong unit
tests/unit/datasets/test_come_back.py
-MM_PER_UNIT[truth_unit] * truth, given.path
+truth, given.path

the first frames of every part of a long recording are drawn | wrong sample
tests/unit/test_run_long.py
-np.arange(-place.start % self.every, place.stop - place.start, self.every)
+np.arange(0, place.stop - place.start, self.every)

counts of a long recording miss its first part | wrong statistics
tests/unit/test_run_long.py
-sum(part[name] for part in parts) for name in _COUNTS
+sum(part[name] for part in parts[1:]) for name in _COUNTS

the person nearest to a point is the farthest | wrong person
tests/unit/test_people_doubts.py
-nearest = min(away, key=lambda who: away[who])
+nearest = max(away, key=lambda who: away[who])
"""

FAULTS = tuple(faults(_PATCHES))
