"""The figure of a hidden wrist, solved over time: ``python docs/figures/sequence.py [FOLDER]``.

The recordings of ``benchmarks/sequences.py``, condition ``occluded 3``: CMU motions (without the data: the
package's synthetic ones), simulated detections, 3 of 4 views occluded. An episode is a time in which at least
two of the four detections of a wrist are missing or wrong. The figure has the episode with the median gain.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np

mpl.use("Agg")

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

import recordings

import skelsplat as sk

BLUE, ORANGE, GREY = "#0072b2", "#d55e00", "#8c8c8c"
CONDITION = "occluded 3"
# A detection farther from the projected joint is wrong, px.
WRONG_PX = 25.0
WRONG_VIEWS = 2
# Least duration of an episode, and what is shown before and after it, s.
LEAST_S, AROUND_S = 0.3, 1.0


@dataclass(frozen=True)
class Episode:
    """A joint whose detections fail in the frames `begin` to `end` of a take."""

    take: recordings.Take
    joint: int
    begin: int
    end: int
    wrong: np.ndarray  # (T,) number of views that miss the joint or are wrong
    solved: dict[str, recordings.Solved]

    def error(self, name: str) -> np.ndarray:
        """Distance to the truth (T,), mm."""
        error = self.solved[name].pose[:, self.joint] - self.take.scene.truth[:, self.joint]
        return np.linalg.norm(error, axis=-1)

    def gain(self) -> float:
        """Mean error solved over time, divided by that frame by frame, during the episode."""
        mean = {name: self.error(name)[self.begin : self.end].mean() for name in ("frames", "sequence")}
        return float(mean["sequence"] / mean["frames"])


def episodes(take: recordings.Take) -> list[Episode]:
    scene, layout = take.scene, sk.layouts.get(take.scene.layout)
    off = scene.detections[..., :2] - np.moveaxis(sk.project(scene.truth, scene.rig), 0, 1)
    right = np.linalg.norm(off, axis=-1) < WRONG_PX
    solved = {name: recordings.METHODS[name](take) for name in ("frames", "butterworth", "sequence")}
    found = []
    around = round(AROUND_S * take.fps)
    for joint in (layout.joints.index(side) for side in ("left_wrist", "right_wrist")):
        wrong = (~right[..., joint]).sum(axis=1)
        edges = np.diff(np.concatenate([[0], wrong >= WRONG_VIEWS, [0]]).astype(int))
        for begin, end in zip(np.flatnonzero(edges > 0), np.flatnonzero(edges < 0), strict=True):
            if end - begin >= LEAST_S * take.fps and begin >= around and end + around <= len(wrong):
                found.append(Episode(take, joint, int(begin), int(end), wrong, solved))
    return found


def draw(episode: Episode) -> Figure:
    fps, joint, scene = episode.take.fps, episode.joint, episode.take.scene
    around = round(AROUND_S * fps)
    shown = slice(episode.begin - around, episode.end + around)
    time = (np.arange(len(scene.truth)) - episode.begin)[shown] / fps
    figure, (above, below) = plt.subplots(
        2, 1, figsize=(8.4, 5.2), sharex=True, layout="constrained", height_ratios=(1.5, 1)
    )
    # The axis along which the frame-by-frame error is largest.
    off = episode.solved["frames"].pose[shown, joint] - scene.truth[shown, joint]
    axis = int((off**2).sum(axis=0).argmax())
    tracks = {name: solved.pose[shown, joint, axis] for name, solved in episode.solved.items()}
    sequence = episode.solved["sequence"]
    assert sequence.covariance is not None
    bar = 2.0 * np.sqrt(sequence.covariance[shown, joint, axis, axis])
    above.fill_between(time, tracks["sequence"] - bar, tracks["sequence"] + bar, color=BLUE, alpha=0.2, lw=0)
    above.plot(time, scene.truth[shown, joint, axis], color="black", lw=2.2, label="truth")
    styles = {
        "frames": {"color": GREY, "ls": ":", "marker": ".", "ms": 6, "label": "frame by frame"},
        "butterworth": {"color": ORANGE, "lw": 1.4, "label": "the same, Butterworth 6 Hz"},
        "sequence": {"color": BLUE, "lw": 1.8, "label": "solved over time, with 2 σ"},
    }
    for name, style in styles.items():
        above.plot(time, tracks[name], **style)
        below.plot(time, episode.error(name)[shown], **style)
    for panel in (above, below):
        panel.fill_between(
            time,
            0.0,
            1.0,
            transform=panel.get_xaxis_transform(),
            where=episode.wrong[shown] >= WRONG_VIEWS,
            step="mid",
            color="#f0e442",
            alpha=0.35,
            lw=0,
            label="missing or wrong in two views or more",
        )
    above.set(ylabel=f"{'xyz'[axis]} of the wrist [mm]")
    below.set(xlabel="time [s]", ylabel="error [mm]", xlim=(time[0], time[-1]), ylim=(0.0, None))
    above.legend(fontsize=8, frameon=False, loc="lower left")
    return figure


def main(folder: Path) -> None:
    found = [e for take in recordings.takes(CONDITION) for e in episodes(take)]
    found.sort(key=Episode.gain)
    chosen = found[len(found) // 2]
    gains = np.array([e.gain() for e in found])
    mean = {name: chosen.error(name)[chosen.begin : chosen.end].mean() for name in chosen.solved}
    print(f"{len(found)} episodes, error solved over time / frame by frame: quartiles", end=" ")
    print(np.percentile(gains, (0, 25, 50, 75, 100)).round(2), "larger than 1:", (gains > 1).sum())
    print(chosen.take.name, chosen.begin, chosen.end, {name: round(float(x), 1) for name, x in mean.items()})
    with plt.rc_context({"font.size": 9, "axes.spines.top": False, "axes.spines.right": False}):
        draw(chosen).savefig(folder / "sequence.png", dpi=130)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
