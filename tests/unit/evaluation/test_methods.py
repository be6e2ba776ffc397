"""Every method of the registry gives the poses of what it is named after."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import skelsplat as sk
import takes
from skelsplat import temporal
from skelsplat.evaluation import baselines, methods
from skelsplat.evaluation.methods import without_lens

TAKE = takes.simulated(3).takes[0]
# Frames 0 to 24 and 29 to 39, and then a single one.
RECORDING = takes.recording().takes[0]
RECORDING = replace(RECORDING, frames=np.append(RECORDING.frames[:-1], 45))
OVER_TIME = ("annealed-butterworth", "over-time")
ALONE = [name for name in methods.names if name not in OVER_TIME]
LAYOUT = sk.layouts.H36M17


def solved(name: str, options: methods.Options | None = None, take=TAKE) -> np.ndarray:
    method = methods.get(name)
    return method.solve(take, LAYOUT, method.settings(options or methods.Options())).pose


def refined(start, config, **keywords) -> np.ndarray:
    return sk.refine(start, TAKE.detections, TAKE.rig, layout=LAYOUT, config=config, **keywords).pose


def fused() -> np.ndarray:
    return sk.fuse_monocular(TAKE.monocular, TAKE.detections, TAKE.rig)


def by_dlt() -> np.ndarray:
    return sk.triangulate(TAKE.detections[..., :2], TAKE.rig, method="dlt")


CLOSED_FORM = sk.RefineConfig.paper(renderer="closed_form")
BOX_SCALE = np.full((3, 4), 2.0)  # the box of the take is 384 × 768 px
EXPECTED = {
    "dlt": lambda: baselines.dlt(TAKE.detections, TAKE.rig),
    "dlt-confidence": lambda: baselines.dlt(TAKE.detections, TAKE.rig, confidence=True),
    "ransac-iskakov": lambda: baselines.ransac_iskakov(TAKE.detections, TAKE.rig, crop_scale=BOX_SCALE),
    "ransac-adafuse": lambda: baselines.ransac_adafuse(TAKE.detections, TAKE.rig),
    "ransac": lambda: sk.triangulate(TAKE.detections, TAKE.rig, method="ransac"),
    "cauchy": lambda: baselines.cauchy(TAKE.detections, TAKE.rig),
    "fusion": fused,
    "annealed": lambda: refined(None, None),
    "annealed-prior": lambda: refined(fused(), None, init_sigma=25.0),
    "paper-closed-form": lambda: refined(by_dlt(), CLOSED_FORM),
    "paper": lambda: refined(by_dlt(), sk.RefineConfig.paper()),
    "paper-ransac": lambda: refined(
        sk.triangulate(TAKE.detections, TAKE.rig, method="ransac"), sk.RefineConfig.paper()
    ),
}


@pytest.mark.parametrize("name", ALONE)
def test_a_method_is_what_its_name_says(name: str) -> None:
    np.testing.assert_array_equal(solved(name), EXPECTED[name]())


@pytest.mark.parametrize("name", ["ransac-iskakov", "annealed-prior", "paper-closed-form", *OVER_TIME])
def test_settings_are_json_and_say_everything(name: str) -> None:
    method, take = methods.get(name), RECORDING if name in OVER_TIME else TAKE
    settings = json.loads(json.dumps(method.settings(methods.Options())))
    again = method.solve(take, LAYOUT, settings).pose
    np.testing.assert_array_equal(again, solved(name, take=take))


# What each method over time makes of one stretch of consecutive frames, solved alone before.
STRETCHES = {
    "annealed-butterworth": lambda part, alone: temporal.butterworth(alone.pose[part], 25.0, 6.0)[0],
    "over-time": lambda part, _: (
        sk.refine_sequence(RECORDING.detections[part], RECORDING.rig, fps=25.0, layout=LAYOUT).pose
    ),
}


@pytest.mark.parametrize("name", OVER_TIME)
def test_methods_over_time_never_cross_a_gap(name: str) -> None:
    alone = sk.refine(None, RECORDING.detections, RECORDING.rig, layout=LAYOUT)
    found = solved(name, take=RECORDING)
    for part in (slice(0, 25), slice(25, 35)):
        np.testing.assert_array_equal(found[part], STRETCHES[name](part, alone))
    last = sk.refine(None, RECORDING.detections[35:], RECORDING.rig, layout=LAYOUT).pose
    np.testing.assert_allclose(found[35], last[0], atol=1e-9)
    error = np.linalg.norm(found[:25] - RECORDING.truth[:25], axis=-1).mean()
    assert error < np.linalg.norm(alone.pose[:25] - RECORDING.truth[:25], axis=-1).mean()


@pytest.mark.parametrize("name", OVER_TIME)
def test_methods_over_time_ask_for_the_rate_and_consecutive_frames(name: str) -> None:
    with pytest.raises(sk.DatasetError, match=f"fps: .* {name}"):
        solved(name, take=replace(RECORDING, fps=None))
    with pytest.raises(sk.DatasetError, match=f"frames: .* {name}"):
        solved(name, take=RECORDING.select(slice(None, None, 2)))


@pytest.mark.parametrize("name", ["dlt", "annealed"])
def test_as_paper_ignores_the_lens(name: str) -> None:
    bare = replace(TAKE, rig=without_lens(TAKE.rig))
    found = solved(name, methods.Options(undistort=False))
    np.testing.assert_array_equal(found, solved(name, take=bare))
    assert not np.array_equal(found, solved(name))


@pytest.mark.parametrize(
    ("name", "options", "lost"),
    [
        ("dlt", {}, "detections"),
        ("fusion", {}, "monocular"),
        ("paper", {"paper_start": "fusion"}, "monocular"),
    ],
)
def test_what_a_take_lacks_is_named(name: str, options, lost: str) -> None:
    with pytest.raises(sk.DatasetError, match=f"{lost}: .* {name}"):
        solved(name, methods.Options(**options), replace(TAKE, **{lost: None}))
