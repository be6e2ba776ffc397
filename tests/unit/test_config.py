"""`RefineConfig`, layouts and cameras as objects."""

from __future__ import annotations

import math

import pytest

import skelsplat as sk
from command_line import assert_fails, invoke


def test_paper_holds_the_papers_values():
    config = sk.RefineConfig.paper()
    assert math.isclose(config.sigma_mm, math.exp(3.0))
    assert (config.max_steps, config.symmetry_weight, config.stop_tolerance) == (125, 1e-5, 1e-6)
    assert (config.method, config.renderer, config.encoding) == ("paper", "raster", "one_hot")
    assert config.views_per_step is None


def test_the_default_is_annealed():
    config = sk.RefineConfig()
    assert config.method == "annealed"
    assert (config.sigma_start_mm, config.sigma_mm, config.sigma_decay) == (320.0, 30.0, 0.5)
    assert (config.sigma_per_noise, config.detection_sigma_px) == (2.0, None)
    assert (config.symmetry_sigma_mm, config.find_swaps) == (15.0, True)
    assert (config.max_steps, config.step_tolerance) == (50, 0.01)


def test_the_method_is_a_keyword_that_does_not_change():
    assert sk.RefineConfig(method="paper") == sk.RefineConfig.paper()
    with pytest.raises(sk.InvalidInputError) as caught:
        sk.RefineConfig().replace(method="paper")
    assert caught.value.argument == "config.method"


@pytest.mark.parametrize("method", ["annealed", "paper"])
def test_the_table_has_every_setting(method):
    config = sk.RefineConfig(method=method)
    table = sk.RefineConfig.settings(method)
    assert {line.name: line.default for line in table} | {"method": method} == config.to_dict()
    assert {line.method for line in table} == {method, "both"}
    for line in table:
        assert line.sentence.endswith(".")
        assert (line.unit == "mm") == line.name.endswith("_mm")
        assert (line.unit == "px") == line.name.endswith("_px")


@pytest.mark.parametrize(("factor", "sigma"), [(1.25, 42.5), (1.5, 90.0), (2.0, 403.4)])
def test_the_occlusion_factor_multiplies_the_log_scale(factor, sigma):
    config = sk.RefineConfig.paper(occlusion_factor=factor)
    assert math.isclose(config.occlusion_sigma_mm, sigma, rel_tol=2e-3)


def test_fields_are_kept_and_replaced():
    config = sk.RefineConfig.paper(sigma_mm=30.0, position_lr_mm="camera_extent", views_per_step=2)
    assert (config.sigma_mm, config.position_lr_mm, config.views_per_step) == (30.0, "camera_extent", 2)
    other = config.replace(sigma_mm=10.0)
    assert (other.sigma_mm, other.views_per_step, config.sigma_mm) == (10.0, 2, 30.0)
    assert sk.RefineConfig.paper(**config.to_dict()) == config
    assert "sigma_mm=30.0" in repr(config)
    with pytest.raises(AttributeError):
        config.sigma_mm = 1.0


@pytest.mark.parametrize("command", [["demo"], ["refine", "c.toml", "d"]])
def test_the_number_of_threads_has_a_bound(command, tmp_path):
    assert_fails(invoke(*command, "--threads", 1025, "-o", tmp_path / "out"), 2, "error: --threads: ")
    assert list(tmp_path.iterdir()) == []
