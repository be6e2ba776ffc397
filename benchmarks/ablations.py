"""Noise on the start, joint encoding and views per step, on simulated detections beside the paper's figures.

    python benchmarks/ablations.py [--poses 300] [--seed 0]

Simulated: six motions in a Human3.6M-like room, the `good` detection noise of ``skelsplat.synthetic``. The
paper's figures are Human3.6M with MeTRAbs detections: compare the shape of a row, not its level.
"""

from __future__ import annotations

import argparse

import numpy as np
from common import simulated
from rich.console import Console
from rich.table import Table

import skelsplat as sk
from skelsplat import synthetic

PAPER_NOISE = {0: 26.7, 10: 27.8, 20: 27.9, 40: 30.6, 60: 41.5, 80: 63.4, 100: 84.6}
PAPER_VIEWS = {1: 30.9, 2: 28.2, 4: 26.7}
PAPER_ENCODING = {"one_hot": 26.7, "rgb": 29.4, "single": 29.4}


class Setting:
    """Poses, simulated detections and their triangulation."""

    def __init__(self, poses: int, seed: int) -> None:
        scene = simulated(poses, seed=seed)
        self.rig, self.truth, self.detections = scene.rig, scene.truth, scene.detections
        self.dlt = sk.triangulate(self.detections[..., :2], self.rig, method="dlt")

    def error(self, start: np.ndarray, **fields: object) -> tuple[float, float]:
        """Return MPJPE in mm and the mean number of steps."""
        config = sk.RefineConfig.paper(**fields)
        result = sk.refine(start, self.detections, self.rig, layout="h36m17", config=config)
        return float(sk.metrics.mpjpe(result.pose, self.truth)), float(result.n_iter.mean())


def show(title: str, column: str, rows: list[tuple[object, float, float, float]]) -> None:
    table = Table(title=title)
    for name in (column, "MPJPE, mm", "steps", "paper, mm"):
        table.add_column(name, justify="right")
    for key, error, steps, paper in rows:
        table.add_row(str(key), f"{error:.1f}", f"{steps:.0f}", f"{paper:.1f}")
    Console(width=100).print(table)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--poses", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    setting = Setting(options.poses, options.seed)
    print(f"{len(setting.truth)} poses, seed {options.seed}; DLT (no weights) ", end="")
    print(f"{float(sk.metrics.mpjpe(setting.dlt, setting.truth)):.1f} mm; simulated detections")

    noisy = {s: synthetic.perturb(setting.dlt, s, seed=options.seed + 1) for s in PAPER_NOISE}
    show(
        "Gaussian noise on the triangulated start",
        "σ per axis, mm",
        [(s, *setting.error(noisy[s]), paper) for s, paper in PAPER_NOISE.items()],
    )
    show(
        "Views whose gradients are accumulated",
        "views per step",
        [(v, *setting.error(setting.dlt, views_per_step=v), p) for v, p in PAPER_VIEWS.items()],
    )
    show(
        "The same without early stopping",
        "views per step",
        [
            (v, *setting.error(setting.dlt, views_per_step=v, stop_tolerance=0.0), p)
            for v, p in PAPER_VIEWS.items()
        ],
    )
    show(
        "Joint encoding",
        "encoding",
        [(e, *setting.error(setting.dlt, encoding=e), p) for e, p in PAPER_ENCODING.items()],
    )


if __name__ == "__main__":
    main()
