"""A live loop for several people: any detector, lists of people in, who is who and their poses out.

    python examples/live_people.py

`sk.Tracker` finds out who is who, in the views and over time. Replace `camera_loop`, here simulated, with
your cameras and detector. A program in another language pipes the same as JSON lines through
`skelsplat live --people all`: `examples/live_client.py`.
"""

from __future__ import annotations

import numpy as np

import skelsplat as sk
from skelsplat import synthetic

rig = synthetic.ring(4, radius_mm=4500)  # yours: skelsplat.io.read_calibration("Calib.toml", unit="m")
scene = synthetic.simulate_scene(2, rig, n_frames=60, fps=30, seed=4)
# per frame a list of views, each (P, N, 3): its people in any order, x, y in pixels and confidence
camera_loop = [[view[np.isfinite(view).any((1, 2))] for view in frame] for frame in scene.people]

tracker = sk.Tracker(rig, layout="h36m17", fps=30, config=sk.RefineConfig(n_threads=1))
wrist = sk.layouts.H36M17.joints.index("right_wrist")
known: set[int] = set()
for people in camera_loop:
    for person in tracker.step(people):
        result = person.refinement
        if result.joint_status[wrist] in ("ok", "inferred"):  # not "weak", "unobserved"
            x, y, z = result.pose[wrist]  # in the unit of the rig
            bar = np.sqrt(np.trace(result.error_bar[wrist]) / 3)
            print(f"person {person.id}: wrist {x:6.0f} {y:6.0f} {z:6.0f} ± {bar:.0f} {rig.unit}")
    for ended in known - set(tracker.ids):
        print(f"person {ended} is gone")
    known = set(tracker.ids)
