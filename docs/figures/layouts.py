"""The figure of the built-in layouts: ``python docs/figures/layouts.py [FOLDER]``.

The joints stand roughly where a standing person, a hand, a mouse or a fly has them: the drawings explain
names and limbs and are no measurements. Left is blue, right is orange, as in all pictures.
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np

mpl.use("Agg")

import matplotlib.pyplot as plt
from matplotlib.axes import Axes

import skelsplat as sk
from skelsplat import layouts

LEFT, RIGHT, MIDDLE = "#0072b2", "#d55e00", "#222222"
COLUMNS = 5

# Joints of a person seen from the front, in cm: to the person's left, and up; of two sides, the left one.
BODY = {
    "pelvis": (0, 96), "spine": (0, 118), "neck": (0, 146), "nose": (0, 160), "head": (0, 176),
    "hip": (10, 93), "knee": (12, 50), "ankle": (13, 9), "heel": (12, 3), "big_toe": (16, 0),
    "small_toe": (21, 1), "foot_index": (18, 0), "shoulder": (19, 143), "elbow": (27, 116),
    "wrist": (32, 90), "eye": (3.5, 164), "ear": (8, 161), "eye_inner": (2, 164.5),
    "eye_outer": (5.5, 164), "mouth": (3, 154), "pinky": (36, 81), "index": (33, 79), "thumb": (29, 82),
}  # fmt: skip
# Base and tip of the fingers of a hand that is one unit long, from the wrist; the thumb points to the body.
FINGERS = {
    "thumb": ((-0.22, -0.16), (-0.45, -0.55)),
    "forefinger": ((-0.16, -0.52), (-0.22, -0.92)),
    "middle_finger": ((-0.02, -0.55), (-0.02, -1.0)),
    "ring_finger": ((0.10, -0.52), (0.16, -0.93)),
    "pinky_finger": ((0.20, -0.46), (0.32, -0.80)),
}
# The same fingers by MediaPipe's names.
SAME = {"index_finger": "forefinger", "pinky": "pinky_finger", "ring_finger": "ring_finger"}
PHALANX = {"cmc": 0, "mcp": 0, "pip": 1, "ip": 2, "dip": 2, "tip": 3}
# A mouse seen from above: forwards is up.
MOUSE = {
    "nose": (0, 42), "neck": (0, 24), "body_middle": (0, 0), "tail_root": (0, -28), "tail_middle": (4, -58),
    "tail_end": (-3, -90), "ear_tip": (12, 33), "shoulder": (9, 20), "elbow": (15, 15), "paw_end": (17, 22),
    "paw": (18, 28), "hip": (9, -22), "knee": (18, -14), "foot": (22, -24),
}  # fmt: skip
# Legs of a fly seen from above, from the body outwards; in front, in the middle, behind.
LEGS = {
    "front": [(5, 20), (10, 27), (20, 36), (26, 46), (28, 56)],
    "middle": [(6, 10), (14, 11), (27, 16), (40, 11), (50, 8)],
    "hind": [(5, 0), (13, -8), (24, -18), (32, -32), (38, -46)],
}
PARTS = ("coxa", "femur", "tibia", "tarsus", "claw")
FLY = {"antenna": (3, 38), "stripe1": (7, -14), "stripe2": (6, -24), "stripe3": (4, -34)}


def face() -> list[tuple[float, float]]:
    """Return the 68 points of a face in the order of iBUG 68, from the person's right, about its middle."""
    jaw = [(-8.5 * np.cos(np.pi * k / 16), 2 - 13 * np.sin(np.pi * k / 16)) for k in range(17)]
    brows = [(side * (7 - 1.3 * k), 6 + 1.5 * np.sin(np.pi * k / 4)) for side in (-1,) for k in range(5)]
    brows += [(-x, y) for x, y in reversed(brows)]
    nose = [(0, 3.5 - 1.7 * k) for k in range(4)] + [(-1.8 + 0.9 * k, -3 - 0.3 * (k == 2)) for k in range(5)]
    eye = [(-5.5, 3), (-4.4, 4), (-3.2, 4), (-2.1, 3), (-3.2, 2.2), (-4.4, 2.2)]
    eyes = eye + [(-x, y) for x, y in (eye[3], eye[2], eye[1], eye[0], eye[5], eye[4])]
    angles = np.pi - np.arange(12) * np.pi / 6
    mouth = [(3.6 * np.cos(a), -6.8 + 1.8 * np.sin(a)) for a in angles]
    inner = [(2.4 * np.cos(a), -6.8 + 0.7 * np.sin(a)) for a in np.pi - np.arange(8) * np.pi / 4]
    return [*jaw, *brows, *nose, *eyes, *mouth, *inner]


def place(name: str, layout: sk.Layout) -> tuple[float, float]:
    """Return where a joint is drawn, to the body's left and up."""
    side = -1.0 if name.startswith("right_") else 1.0
    bare = name.removeprefix("left_").removeprefix("right_")
    if layout.name == "hand21":
        return (0.0, 0.0) if bare == "wrist" else finger(bare)
    if layout.name == "mouse22":
        x, y = MOUSE[bare]
        return side * x, y
    if layout.name == "fly38":
        leg, _, part = bare.partition("_")
        x, y = LEGS[leg][PARTS.index(part)] if leg in LEGS else FLY[bare]
        return side * x, y
    if bare.startswith("face_"):
        x, y = face()[int(bare[5:])]
        return x, 161 + y
    if bare in BODY:
        x, y = BODY[bare]
        return (side * x, y) if name != bare else (x, y)
    x, y = (0.0, 0.0) if bare == "hand_root" else finger(bare)
    return side * (BODY["wrist"][0] + 4 + 20 * x), BODY["wrist"][1] - 3 + 20 * y


def finger(name: str) -> tuple[float, float]:
    """Return a joint of a finger, from its base to its tip, of a hand of length 1."""
    stem, _, part = name.rpartition("_")
    if part in PHALANX:
        which = SAME.get(stem, stem)
        step = ("cmc", "mcp", "ip", "tip").index(part) if stem == "thumb" else PHALANX[part]
    else:
        which, step = name[:-1], int(name[-1]) - 1
    base, tip = FINGERS[which]
    return tuple(base[axis] + (tip[axis] - base[axis]) * step / 3 for axis in (0, 1))


def draw(axes: Axes, layout: sk.Layout) -> None:
    """Draw a layout with its limbs and sides, seen from the front: the body's left is on the right."""
    at = np.array([place(name, layout) for name in layout.joints])
    left = {pair[0] for pair in layout.left_right}
    right = {pair[1] for pair in layout.left_right}

    def colour(*joints: int) -> str:
        if all(joint not in left for joint in joints):
            return RIGHT if any(joint in right for joint in joints) else MIDDLE
        return LEFT if all(joint not in right for joint in joints) else MIDDLE

    for limb in layout.limbs:
        axes.plot(*at[list(limb)].T, color=colour(*limb), linewidth=1.2, zorder=1)
    size = 5 if layout.n_joints > 100 else 12
    axes.scatter(*at.T, s=size, color=[colour(k) for k in range(len(at))], zorder=2, linewidths=0)
    axes.set_title(f"{layout.name}, {layout.n_joints} joints", fontsize=9)
    axes.set_aspect("equal")
    axes.margins(0.06)
    axes.axis("off")


def main(folder: Path) -> None:
    rows = -(-len(layouts.names) // COLUMNS)
    figure, grid = plt.subplots(rows, COLUMNS, figsize=(9.0, 3.1 * rows), layout="constrained")
    for axes in grid.flat[len(layouts.names) :]:
        axes.axis("off")
    for axes, name in zip(grid.flat, layouts.names, strict=False):
        draw(axes, layouts.get(name))
    figure.text(0.99, 0.01, "blue: left   orange: right", ha="right", fontsize=9)
    figure.savefig(folder / "layouts.png", dpi=110, metadata={"Software": None})


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
