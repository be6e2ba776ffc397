"""The definitions of the joint angles as stick figures: ``python docs/figures/angles.py [FOLDER]``.

Every number is what `skelsplat.joint_angles` returns for the drawn pose.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np

mpl.use("Agg")

import matplotlib.pyplot as plt
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import skelsplat as sk

BLUE, ORANGE, GREY, PALE = "#0072b2", "#d55e00", "#8c8c8c", "#c4c4c4"
EDGE = [patheffects.withStroke(linewidth=3, foreground="white")]
LAYOUT = sk.layouts.HALPE26
# x forward, y left, z up, mm: upright standing
STANDING = {
    "hip": (0, 120, 880),
    "knee": (0, 120, 470),
    "ankle": (0, 120, 80),
    "heel": (-60, 120, 20),
    "big_toe": (170, 120, 20),
    "shoulder": (0, 190, 1390),
    "elbow": (0, 190, 1090),
    "wrist": (0, 190, 840),
}
CHAINS = (("shoulder", "elbow", "wrist"), ("hip", "knee", "ankle"), ("heel", "big_toe"))
FRONT, SIDE = (1, 2), (0, 2)  # what is drawn to the right and upwards
Point = np.ndarray


@dataclass(frozen=True)
class Panel:
    """One angle: which, how it is seen, the joints that turn, and the lines between which it lies."""

    name: str
    view: tuple[int, int]
    turns: tuple[
        tuple[tuple[str, ...], str, tuple[float, float]], ...
    ]  # joints, about, forward and to the left
    vertex: tuple[str, ...]
    limb: tuple[tuple[str, ...], tuple[str, ...]]  # from, to
    zero: tuple[tuple[str, ...], tuple[str, ...]] | tuple[float, float]  # where the angle is 0
    words: str
    window: tuple[float, float, float] = (
        -620.0,
        -60.0,
        1860.0,
    )  # left, bottom and height of what is shown, mm
    moved: tuple[float, float] = (0.0, 0.0)  # of the number, off limbs, mm


HIPS, SHOULDERS = ("left_hip", "right_hip"), ("left_shoulder", "right_shoulder")
LEG, ARM = ("knee", "ankle", "heel", "big_toe"), ("elbow", "wrist")


def left(*names: str) -> tuple[str, ...]:
    return tuple(f"left_{name}" for name in names)


TRUNK = (*SHOULDERS, *left("elbow", "wrist"), "right_elbow", "right_wrist", "head", "neck", "nose")
PANELS = (
    Panel(
        "left_hip_flexion",
        SIDE,
        ((left(*LEG), "left_hip", (40, 0)),),
        left("hip"),
        (left("hip"), left("knee")),
        (SHOULDERS, HIPS),
        "thigh, forward of the\ntrunk line",
    ),
    Panel(
        "left_knee_flexion",
        SIDE,
        ((left(*LEG[1:]), "left_knee", (-55, 0)),),
        left("knee"),
        (left("knee"), left("ankle")),
        (left("hip"), left("knee")),
        "shank, off the line\nof the thigh",
        moved=(390, 110),
    ),
    Panel(
        "left_ankle_dorsiflexion",
        SIDE,
        ((left("heel", "big_toe"), "left_ankle", (20, 0)),),
        left("heel"),
        (left("heel"), left("big_toe")),
        (1.0, 0.0),
        "heel to big toe, above the\nperpendicular of the shank",
        (-230.0, -40.0, 720.0),
        (35, 0),
    ),
    Panel(
        "left_shoulder_flexion",
        SIDE,
        ((left(*ARM), "left_shoulder", (75, 0)),),
        left("shoulder"),
        (left("shoulder"), left("elbow")),
        (SHOULDERS, HIPS),
        "upper arm, forward of\nthe trunk line",
    ),
    Panel(
        "left_elbow_flexion",
        SIDE,
        ((left("wrist"), "left_elbow", (80, 0)),),
        left("elbow"),
        (left("elbow"), left("wrist")),
        (left("shoulder"), left("elbow")),
        "forearm, off the line\nof the upper arm",
    ),
    Panel(
        "left_hip_abduction",
        FRONT,
        ((left(*LEG), "left_hip", (0, 30)),),
        left("hip"),
        (left("hip"), left("knee")),
        (SHOULDERS, HIPS),
        "thigh, out of the\nsagittal plane",
        moved=(-70, -40),
    ),
    Panel(
        "left_shoulder_abduction",
        FRONT,
        ((left(*ARM), "left_shoulder", (0, 60)),),
        left("shoulder"),
        (left("shoulder"), left("elbow")),
        (SHOULDERS, HIPS),
        "upper arm, out of the\nsagittal plane",
    ),
    Panel(
        "trunk_inclination",
        SIDE,
        ((TRUNK, "hips", (25, 0)),),
        HIPS,
        (HIPS, SHOULDERS),
        (0.0, 1.0),
        "trunk line, to any side\nof the vertical; no sign",
        moved=(25, 50),
    ),
    Panel(
        "trunk_forward_lean",
        SIDE,
        ((TRUNK, "hips", (-30, 0)),),
        HIPS,
        (HIPS, SHOULDERS),
        (0.0, 1.0),
        "trunk line, forward\nof the vertical",
        moved=(-25, 60),
    ),
    Panel(
        "trunk_side_lean",
        FRONT,
        ((TRUNK, "hips", (0, -25)),),
        HIPS,
        (HIPS, SHOULDERS),
        (0.0, 1.0),
        "trunk line, to the left\nof the vertical",
        moved=(-150, 170),
    ),
    Panel(
        "pelvis_obliquity",
        FRONT,
        ((left("hip"), "right_hip", (0, 14)),),
        ("right_hip",),
        (("right_hip",), ("left_hip",)),
        (1.0, 0.0),
        "left hip above\nthe right",
        (-350.0, 540.0, 950.0),
        (-140, -105),
    ),
)


def pose_of(panel: Panel) -> dict[str, Point]:
    """Upright standing with the turns of a panel."""
    pose = {
        "head": np.array([0.0, 0, 1680]),
        "neck": np.array([0.0, 0, 1440]),
        "nose": np.array([90.0, 0, 1580]),
    }
    for name, (x, y, z) in STANDING.items():
        pose |= {f"left_{name}": np.array([x, y, z], float), f"right_{name}": np.array([x, -y, z], float)}
    for joints, about, (forward, sideways) in panel.turns:
        centre = middle(pose, HIPS) if about == "hips" else pose[about]
        f, s = np.radians([forward, sideways])
        swing = np.array([[np.cos(f), 0, -np.sin(f)], [0, 1, 0], [np.sin(f), 0, np.cos(f)]])
        raise_ = np.array([[1, 0, 0], [0, np.cos(s), -np.sin(s)], [0, np.sin(s), np.cos(s)]])
        for joint in joints:
            pose[joint] = centre + raise_ @ swing @ (pose[joint] - centre)
    return pose


def middle(pose: dict[str, Point], joints: tuple[str, ...]) -> Point:
    return np.mean([pose[joint] for joint in joints], axis=0)


def degrees_of(pose: dict[str, Point], name: str) -> float:
    array = np.array([pose.get(joint, np.full(3, np.nan)) for joint in LAYOUT.joints])
    return float(sk.joint_angles(array, layout=LAYOUT)[name])


def draw(axes: Axes, panel: Panel) -> None:
    pose, view = pose_of(panel), list(panel.view)
    x, y, height = panel.window
    at = {name: place[view] for name, place in pose.items()}

    def line(places: list[Point], **style: object) -> None:
        axes.plot(*np.transpose(places), solid_capstyle="round", **style)

    for side, colour in (("right", PALE), ("left", GREY)):
        for chain in CHAINS:
            line([at[f"{side}_{name}"] for name in chain], color=colour, lw=3)
        line([at[f"{side}_ankle"], at[f"{side}_heel"]], color=colour, lw=3)
    for pair in (HIPS, SHOULDERS):
        line([at[joint] for joint in pair], color=GREY, lw=3)
    line([middle(at, HIPS), middle(at, SHOULDERS)], color=GREY, lw=3)
    head = at["head"] - (at["head"] - at["neck"]) / 4
    line([middle(at, SHOULDERS), head], color=GREY, lw=3)
    axes.add_patch(plt.Circle(head, 105, color=GREY))
    vertex = middle(at, panel.vertex)
    start, end = (middle(at, joints) for joints in panel.limb)
    line([start, end], color=BLUE, lw=4)
    zero = panel.zero
    fixed = isinstance(zero[0], float)
    towards = np.array(zero) if fixed else middle(at, zero[1]) - middle(at, zero[0])
    towards = towards / np.linalg.norm(towards)
    reach = 0.95 * max(np.linalg.norm(end - start), 260)
    line([vertex, vertex + reach * towards], color=ORANGE, lw=1.4, ls=(0, (4, 2)))
    if not fixed and panel.zero[0] == SHOULDERS:
        line([middle(at, SHOULDERS), middle(at, HIPS)], color=ORANGE, lw=1.4, ls=(0, (4, 2)))
    limb = (end - start) / np.linalg.norm(end - start)
    first = np.arctan2(towards[1], towards[0])
    turn = np.arctan2(towards[0] * limb[1] - towards[1] * limb[0], towards @ limb)
    arc = first + np.linspace(0, turn, 40)
    line(list(vertex + 0.72 * reach * np.stack([np.cos(arc), np.sin(arc)], axis=1)), color=ORANGE, lw=1.6)
    degrees = degrees_of(pose, panel.name)
    assert np.isclose(abs(np.degrees(turn)), degrees), (panel.name, np.degrees(turn), degrees)
    middle_of_arc = np.array([np.cos(first + turn / 2), np.sin(first + turn / 2)])
    label = vertex + (0.72 * reach + 0.09 * height) * middle_of_arc + panel.moved
    style = {"fontsize": 10, "weight": "bold", "ha": "center", "va": "center", "path_effects": EDGE}
    axes.text(
        *label,
        f"{degrees:.0f}°" if "inclination" in panel.name else f"{degrees:+.0f}°",
        color=ORANGE,
        zorder=5,
        **style,
    )
    axes.set(xlim=(x, x + 0.72 * height), ylim=(y, y + height), aspect="equal")
    axes.axhline(0, color=PALE, lw=1, zorder=0)
    axes.axis("off")
    title = panel.name.removeprefix("left_").replace("_", " ")
    seen = "from the side, facing right" if panel.view == SIDE else "from the front"
    axes.set_title(f"{title}\n", fontsize=10, weight="bold", pad=2)
    about = {"ha": "center", "transform": axes.transAxes}
    axes.text(0.5, 1.02, f"seen {seen}", fontsize=7.5, color=GREY, **about)
    axes.text(0.5, -0.03, panel.words, va="top", fontsize=8.5, **about)


def definitions() -> Figure:
    """Each angle on the left side of the body, positive."""
    figure, axes = plt.subplots(2, 6, figsize=(12.4, 7.4), layout="constrained")
    for axis, panel in zip(axes.flat, PANELS, strict=False):
        draw(axis, panel)
    axes.flat[-1].axis("off")
    return figure


if __name__ == "__main__":
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent
    definitions().savefig(folder / "joint-angles.png", dpi=110, metadata={"Software": "skelsplat"})
