"""Figures of the method, computed by the library: ``python docs/figures/method.py [FOLDER]``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np

mpl.use("Agg")

import matplotlib.pyplot as plt
from matplotlib.patches import Ellipse

import skelsplat as sk
from skelsplat import synthetic

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BLUE, ORANGE, GREY = "#0072b2", "#d55e00", "#8c8c8c"
SIGMAS = (20, 40, 80, 160, 320)
STARTS = (0, 20, 40, 60, 80, 100, 150, 200, 300, 400)
JOINT = np.array([[0.0, 0.0, 1000.0]])


def splat() -> Figure:
    """Render, pseudo ground truth and their squared difference for one joint in one view."""
    camera = synthetic.human36m_like()[0]
    covariance = np.diag([60.0, 25.0, 40.0])[None] ** 2
    detection = sk.project(JOINT, [camera])[0] + [22.0, -12.0]
    render = sk.render(JOINT, covariance, camera)[0]
    target = sk.pseudo_ground_truth(detection, JOINT, covariance, camera)[0]
    u, v = np.round(detection[0]).astype(int)
    window = np.s_[v - 45 : v + 60, u - 75 : u + 50]
    figure, axes = plt.subplots(1, 3, figsize=(8.4, 2.9), layout="constrained")
    for axis, image, title in zip(
        axes,
        (render, target, (render - target) ** 2),
        ("render: the joint's splat", "pseudo ground truth", "squared difference"),
        strict=True,
    ):
        axis.imshow(image[window], cmap="magma", vmin=0.0, vmax=1.0, interpolation="nearest")
        axis.set(title=title, xticks=[], yticks=[])
        axis.plot(75, 45, "+", color="white", ms=10, label="detection")
    return figure


def kernel() -> Figure:
    """Loss of one channel over the distance from the detection: pixels, the closed form, and its weight."""
    camera = synthetic.human36m_like()[0]
    seen = sk.project(JOINT, [camera])
    side = camera.R[0]
    offsets = np.linspace(0.0, 250.0, 60)
    figure, (left, right) = plt.subplots(1, 2, figsize=(8.4, 3.2), layout="constrained")
    for sigma, colour in zip(
        SIGMAS, plt.get_cmap("viridis")(np.linspace(0.0, 0.85, len(SIGMAS))), strict=True
    ):
        exact = [_loss(JOINT + x * side, seen, camera, sigma, "closed_form") for x in offsets]
        most = _loss(JOINT + 6.0 * sigma * side, seen, camera, sigma, "closed_form")
        left.plot(offsets, np.array(exact) / most, color=colour, label=f"σ = {sigma} mm")
        right.plot(offsets, 1.0 - np.array(exact) / most, color=colour)
    pixels = [_loss(JOINT + x * side, seen, camera, SIGMAS[0], "raster") for x in offsets[::4]]
    left.plot(offsets[::4], np.array(pixels) / pixels[-1], ".", color="black", label="pixels, σ = 20 mm")
    left.set(
        xlabel="distance from the ray [mm]",
        ylabel="loss, part of the largest",
        title="what is minimised",
        ylim=(-0.05, 1.75),
    )
    right.set(xlabel="distance from the ray [mm]", ylabel="weight k", title="how much a detection is trusted")
    right.axhline(sk.REJECTED_WEIGHT, color=GREY, lw=1, ls="--")
    right.text(250, sk.REJECTED_WEIGHT + 0.02, "below: rejected", ha="right", color=GREY, fontsize=8)
    left.legend(fontsize=8, frameon=False, ncols=2, loc="upper right")
    return figure


def _loss(means: np.ndarray, seen: np.ndarray, camera: sk.Camera, sigma: float, renderer: str) -> float:
    config = sk.RefineConfig.paper(renderer=renderer, symmetry_tier=0, dilation=1e-6)
    scales, turns = np.full((1, 3), np.log(sigma)), np.array([[1.0, 0.0, 0.0, 0.0]])
    shape = np.eye(3)[None] * sigma**2
    return sk.loss_and_gradient(
        means, scales, turns, seen, [camera], config=config, target_means=JOINT, target_covariances=shape
    ).loss


def annealing() -> Figure:
    """Left: the loss along a line for a joint of which one of four views is wrong. Right: errors by start."""
    rig = synthetic.human36m_like()
    seen = sk.project(JOINT, rig)
    seen[0] += 130.0
    figure, (left, right) = plt.subplots(1, 2, figsize=(8.4, 3.2), layout="constrained")
    wrong = sk.triangulate(seen[:2], list(rig)[:2], method="dlt")
    towards = (wrong - JOINT) / np.linalg.norm(wrong - JOINT)
    line = np.linspace(-600.0, 900.0, 301)
    for sigma, colour in zip((320, 80, 20), (GREY, ORANGE, BLUE), strict=True):
        config = sk.RefineConfig.paper(renderer="closed_form", symmetry_tier=0, dilation=1e-6)
        scales, turns = np.full((1, 3), np.log(sigma)), np.array([[1.0, 0.0, 0.0, 0.0]])
        loss = [
            sk.loss_and_gradient(JOINT + x * towards, scales, turns, seen, rig, config=config).loss
            for x in line
        ]
        left.plot(line, np.array(loss) / max(loss), color=colour, label=f"σ = {sigma} mm")
    left.axvline(0.0, color="black", lw=1, ls=":")
    left.set(
        xlabel="position on a line through the joint [mm]",
        ylabel="loss",
        title="wide: pulls from afar. narrow: exact",
    )
    left.legend(fontsize=8, frameon=False)
    _starts(right)
    return figure


def _starts(axis: Axes) -> None:
    rig = synthetic.human36m_like()
    truth = synthetic.motion("walk", 40, seed=0)
    noise = synthetic.DetectionNoise.good()
    detections = synthetic.simulate_detections(truth, rig, noise=noise, seed=0)
    for config, label, colour in (
        (sk.RefineConfig.paper(), "paper", ORANGE),
        (sk.RefineConfig(), "annealed", BLUE),
    ):
        errors = []
        for sigma in STARTS:
            start = synthetic.perturb(truth, sigma, seed=1)
            result = sk.refine(start, detections, rig, layout="h36m17", config=config)
            errors.append(sk.metrics.mpjpe(result.pose, truth))
        axis.plot(STARTS, errors, "o-", ms=3, color=colour, label=label)
    axis.set(
        xlabel="noise on the start, per axis [mm]",
        ylabel="mean error [mm]",
        yscale="log",
        title="where it ends",
    )
    axis.legend(fontsize=8, frameon=False)


def ellipsoids() -> Figure:
    """Seen from above: where 300 simulated repetitions put a joint, and the scatter they came with."""
    rigs = {
        "two cameras side by side": synthetic.stereo(),
        "four cameras round the room": synthetic.human36m_like(),
    }
    figure, axes = plt.subplots(1, 2, figsize=(8.4, 3.6), layout="constrained")
    for axis, (title, rig) in zip(axes, rigs.items(), strict=True):
        pose = synthetic.motion("reach", 1, seed=2)
        pose[..., :2] -= pose[..., :2].mean(axis=1, keepdims=True)
        seen = sk.project(pose[0], rig)
        noisy = seen + np.random.default_rng(0).normal(0.0, 3.0, (300, *seen.shape))
        result = sk.refine(None, noisy, rig, layout="h36m17", config=sk.RefineConfig(symmetry_tier=0))
        wrist = sk.layouts.H36M17.joints.index("right_wrist")
        error = result.pose[:, wrist] - pose[0, wrist]
        axis.plot(error[:, 0], error[:, 1], ".", ms=3, color=GREY, label="results")
        cover = np.median(result.uncertainty[:, wrist, :2, :2], axis=0)
        for k in (1, 2):
            axis.add_patch(_ellipse(cover, k, label=f"scatter, {k} σ"))
        axis.set(title=title, xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
        reach = 1.15 * np.abs(error[:, :2]).max()
        axis.set(xlim=(-reach, reach), ylim=(-reach, reach))
    axes[0].legend(fontsize=8, frameon=False)
    return figure


def _ellipse(covariance: np.ndarray, k: float, label: str) -> Ellipse:
    values, axes = np.linalg.eigh(covariance)
    angle = np.degrees(np.arctan2(axes[1, 1], axes[0, 1]))
    width, height = 2 * k * np.sqrt(values[::-1])
    colour = BLUE if k == 1 else ORANGE
    return Ellipse((0, 0), width, height, angle=angle, fill=False, color=colour, lw=1.5, label=label)


def main(folder: Path) -> None:
    with plt.rc_context({"font.size": 9, "axes.spines.top": False, "axes.spines.right": False}):
        for draw in (splat, kernel, annealing, ellipsoids):
            draw().savefig(folder / f"{draw.__name__}.png", dpi=130)
    plt.close("all")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
