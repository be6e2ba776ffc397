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
}


@pytest.mark.parametrize("name", ALONE)
def test_a_method_is_what_its_name_says(name: str) -> None:
    np.testing.assert_array_equal(solved(name), EXPECTED[name]())


@pytest.mark.parametrize("name", methods.names)
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


@pytest.mark.parametrize("name", [name for name in ALONE if name != "paper"])
def test_as_paper_ignores_the_lens(name: str) -> None:
    bare = replace(TAKE, rig=without_lens(TAKE.rig))
    found = solved(name, methods.Options(undistort=False))
    np.testing.assert_array_equal(found, solved(name, take=bare))
    assert not np.array_equal(found, solved(name))


def test_the_paper_s_settings_are_those_of_the_data_set() -> None:
    options = methods.Options(paper_start="fusion", paper_fields={"occlusion_factor": 1.25})
    settings = methods.get("paper").settings(options)
    assert settings["start"] == "fusion"
    assert settings["config"]["occlusion_sigma_mm"] == pytest.approx(42.5, abs=0.05)
    config = sk.RefineConfig.paper(renderer="closed_form", occlusion_factor=1.25)
    np.testing.assert_array_equal(solved("paper-closed-form", options), refined(fused(), config))


def test_the_prior_is_in_the_rig_s_unit() -> None:
    rig = sk.CameraRig(
        [sk.Camera(c.K, c.R, c.t / 1000, distortion=c.distortion, size=c.size) for c in TAKE.rig], unit="m"
    )
    metres = replace(TAKE, rig=rig, truth=TAKE.truth / 1000, monocular=TAKE.monocular / 1000)
    options = methods.Options(init_sigma_mm=30.0)
    millimetres = solved("annealed-prior", options)
    np.testing.assert_allclose(1000 * solved("annealed-prior", options, metres), millimetres, atol=1e-4)
    assert not np.allclose(millimetres, solved("annealed-prior"), atol=0.1)


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
