"""Simulated rigs, bodies, motions and detections with known truth; everything is seeded.

A bad argument is an `InvalidInputError` that names it.

>>> from skelsplat import synthetic
>>> synthetic.motion("walk", n_frames=10, seed=1).shape
(10, 17, 3)
"""

from skelsplat.synthetic.crowding import Crowding
from skelsplat.synthetic.crowds import crowd, meeting_names
from skelsplat.synthetic.detections import simulate_detections
from skelsplat.synthetic.motions import motion, motion_names
from skelsplat.synthetic.noise import DetectionNoise, Memory, monocular_poses, perturb
from skelsplat.synthetic.rigs import dome, human36m_like, look_at, ring, stereo, table
from skelsplat.synthetic.scenes import Scene, simulate_scene
from skelsplat.synthetic.sets import set_names, simulate_people_set, simulate_set
from skelsplat.synthetic.skeleton import in_layout

__all__ = [
    "Crowding",
    "DetectionNoise",
    "Memory",
    "Scene",
    "crowd",
    "dome",
    "human36m_like",
    "in_layout",
    "look_at",
    "meeting_names",
    "monocular_poses",
    "motion",
    "motion_names",
    "perturb",
    "ring",
    "set_names",
    "simulate_detections",
    "simulate_people_set",
    "simulate_scene",
    "simulate_set",
    "stereo",
    "table",
]
