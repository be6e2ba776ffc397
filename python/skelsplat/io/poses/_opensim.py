"""What OpenSim needs to find joint angles by inverse kinematics: markers, their weights, and the commands."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from skelsplat._arrays import Array, Mask
from skelsplat._atomic import atomic_write_text
from skelsplat._skelsplat import Layout
from skelsplat.cameras import MM_PER_UNIT
from skelsplat.exceptions import InvalidInputError
from skelsplat.io.poses._markers import IK_SETUPS, as_markers, ik_model, marker_names, with_y_up
from skelsplat.io.poses._pose_data import PoseData, known_frame_rate
from skelsplat.io.poses._trc import write_trc

OPENSIM_FILES = ("opensim/poses.trc", "opensim/ik_setup.xml", "opensim/kinematics.py")
_NEEDED = {side + name for side in "LR" for name in ("Shoulder", "Hip", "Knee", "Ankle")}
# Standard deviation per axis in mm of the distance between a joint without error and the marker of weight 1
# on Pose2Sim's model, scaled to the person: 23 mm on walks of CMU's database.
_MODEL_MM = 25.0
# Pose2Sim's markers of another model, where one of its own, the right hip, is in the middle of the thigh.
_MARKERS = {"COCO_17": "BODY_25"}
# Markers that are left out: this one is 8 cm above the middle of the hips.
_MISPLACED = {("HALPE_136", "Hip")}


def check_opensim(layout: Layout) -> None:
    """Raise `InvalidInputError` before the work if the joints are not enough of a person."""
    if not {*marker_names(layout.joints, "pose2sim")} >= _NEEDED:
        expected = "a layout with left and right shoulders, hips, knees and ankles"
        raise InvalidInputError(f"opensim: expected {expected}, got {layout.name}")


def write_opensim(folder: Path, data: PoseData, up: Array, frame_rate: float | None = None) -> None:
    """Write `OPENSIM_FILES` into ``folder``: markers in m with y up, their weights, the commands.

    ``up`` (3,) is the axis of the world, with its sign, that is up. ``kinematics.py`` scales Pose2Sim's model
    and finds the joint angles; it needs the packages opensim and pose2sim.

    A marker's weight is one over the variance of its distance from the model's marker, to a factor: that of a
    joint without scatter, (25 mm)² / Pose2Sim's weight, and the square of its scatter, the mean over time,
    since OpenSim has one weight for all frames. Pose2Sim's weights are for joints of detectors, with their
    bias.
    """
    rate = known_frame_rate(data, frame_rate, "TRC")
    model = ik_model(data.joint_names)
    pose = data.pose @ with_y_up(up).T
    turned = PoseData(pose, data.joint_names, data.frames, data.unit, uncertainty=data.uncertainty)
    markers = as_markers(turned, "pose2sim")
    wanted = {name: w for name, w in IK_SETUPS[model].weights.items() if (model, name) not in _MISPLACED}
    seen = np.asarray(np.isfinite(markers.pose).all(axis=-1))
    kept = [k for k, name in enumerate(markers.joint_names) if name in wanted and seen[:, k].any()]
    names = tuple(markers.joint_names[k] for k in kept)
    tasks = _tasks({name: wanted[name] for name in names}, _scatter_mm(markers, seen)[kept])
    rows = np.flatnonzero(seen[:, kept].any(axis=1))
    first, last = ((data.frames[rows[[0, -1]]] - data.frames[0]) / rate).tolist() if len(rows) else (0.0, 0.0)
    rows = np.union1d(rows, [0])  # OpenSim stops at a frame without markers; times begin at the first
    path, setup, script = (folder / name for name in OPENSIM_FILES)
    path.parent.mkdir(exist_ok=True)
    pose = markers.pose[rows][:, kept]
    write_trc(path, PoseData(pose, names, data.frames[rows], data.unit), frame_rate=rate)
    atomic_write_text(setup, _SETUP.format(tasks=tasks, first=first, last=last))
    atomic_write_text(script, _SCRIPT.format(model=_MARKERS.get(model, model)))


def _scatter_mm(markers: PoseData, seen: Mask) -> Array:
    """Return the scatter per axis of every marker (N,), the root of its mean variance; 0 if unknown."""
    if not markers.uncertainty.size:
        return np.zeros(len(markers.joint_names))
    variance = np.trace(markers.uncertainty, axis1=-2, axis2=-1) / 3.0
    known = seen & np.isfinite(variance)
    total = np.where(known, variance, 0.0).sum(axis=0)
    scatter: Array = np.sqrt(total / np.maximum(known.sum(axis=0), 1)) * MM_PER_UNIT[markers.unit]
    return scatter


def _tasks(usual: Mapping[str, float], scatter: Array) -> str:
    """Return the markers' tasks with weights, on the whole as heavy as those of Pose2Sim, ``usual``."""
    before = np.array(list(usual.values()))
    weights = 1.0 / (1.0 / before + (scatter / _MODEL_MM) ** 2)
    weights *= before.sum() / max(weights.sum(), np.finfo(float).tiny)
    rows = zip(usual.items(), scatter.tolist(), weights.tolist(), strict=True)
    return "".join(_TASK.format(name=name, usual=w, scatter=mm, weight=now) for (name, w), mm, now in rows)


_TASK = """
        <!--scatter {scatter:.0f} mm, weight in Pose2Sim {usual:g}-->
        <IKMarkerTask name="{name}">
          <apply>true</apply>
          <weight>{weight:.4f}</weight>
        </IKMarkerTask>"""

# with the task of Pose2Sim's set-ups that keeps the spine of its model straight where nothing bends it
_SETUP = """<?xml version="1.0" encoding="UTF-8"?>
<OpenSimDocument Version="40000">
  <InverseKinematicsTool>
    <results_directory>.</results_directory>
    <model_file>poses.osim</model_file>
    <constraint_weight>Inf</constraint_weight>
    <accuracy>1e-05</accuracy>
    <time_range>{first:.6f} {last:.6f}</time_range>
    <output_motion_file>poses.mot</output_motion_file>
    <report_errors>true</report_errors>
    <IKTaskSet>
      <objects>{tasks}
        <IKCoordinateTask name="L5_S1_Flex_Ext">
          <apply>true</apply>
          <weight>0.1</weight>
          <value_type>default_value</value_type>
          <value>0</value>
        </IKCoordinateTask>
      </objects>
    </IKTaskSet>
    <marker_file>poses.trc</marker_file>
    <report_marker_locations>false</report_marker_locations>
  </InverseKinematicsTool>
</OpenSimDocument>
"""

_SCRIPT = '''\
"""Find joint angles with OpenSim.

    pip install opensim pose2sim
    python kinematics.py

Pose2Sim's model is scaled to the person in poses.trc: poses.osim. Its joints follow the markers, each with
its weight in ik_setup.xml: poses.mot, angles in degrees. Both open in OpenSim, and so does ik_setup.xml, in
its inverse kinematics tool.
"""

import os
from pathlib import Path

try:
    import opensim
    from Pose2Sim.kinematics import get_opensim_setup_dir, perform_scaling
except ImportError as error:
    raise SystemExit(f"{{error}}; run: pip install opensim pose2sim") from None

MARKERS = "{model}"  # of Pose2Sim
SIMPLE = False  # True: ten times as fast, with a stiff spine, without patellae and muscles
MASS = 70.0  # kg; does not change the angles

folder = Path(__file__).resolve().parent
os.chdir(folder)  # the paths in ik_setup.xml are relative
perform_scaling(
    folder / "poses.trc",
    MARKERS,
    folder,
    get_opensim_setup_dir(),
    use_simple_model=SIMPLE,
    subject_mass=MASS,
)
opensim.InverseKinematicsTool("ik_setup.xml").run()
'''
