"""A client of `skelsplat live` for several people, as a robot's program in any language would write it.

    python examples/live_client.py

`follow` is the client. Replace `camera_loop`, here simulated, with your cameras and detector.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from subprocess import PIPE, Popen
from typing import Any

import numpy as np

from skelsplat import synthetic
from skelsplat.io import write_calibration


def follow(calibration: Path, frames: Iterable[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    """Yield the answers; a frame has a list of people for each camera's name."""
    options = ["--unit", "mm", "--layout", "h36m17", "--fps", "30", "--people", "all"]
    command = [sys.executable, "-m", "skelsplat", "live", str(calibration), *options]
    with Popen(command, stdin=PIPE, stdout=PIPE, text=True) as live:
        for number, views in enumerate(frames):
            live.stdin.write(json.dumps({"frame": number, "detections": views}) + "\n")
            live.stdin.flush()
            answer = json.loads(live.stdout.readline())  # every line has an answer
            if "error" in answer:
                print(f"frame {number} is lost: {answer['error']}")
            else:
                yield answer
        live.stdin.close()


rig = synthetic.ring(4, radius_mm=4500)
scene = synthetic.simulate_scene(2, rig, n_frames=45, fps=30, seed=4)
camera_loop = [
    {name: np.nan_to_num(view).tolist() for name, view in zip(rig.names, views, strict=True)}
    for views in scene.people
]
camera_loop[20] = {"cam7": []}  # a mistake: there is no such camera
wrist = scene.layout.joints.index("right_wrist")

with tempfile.TemporaryDirectory() as folder:
    write_calibration(Path(folder) / "Calib.toml", rig)
    for answer in follow(Path(folder) / "Calib.toml", camera_loop):
        for person in answer["people"]:
            if person["joint_status"][wrist] in ("ok", "inferred"):
                x, y, z = person["pose"][wrist]
                print(f"frame {answer['frame']}, person {person['id']}: wrist {x:6.0f} {y:6.0f} {z:6.0f} mm")
        for number in answer["ended"]:
            print(f"person {number} is gone")
