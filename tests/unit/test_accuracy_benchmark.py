"""The measuring programs run, on few poses; what they measure is not judged here."""

from __future__ import annotations

import importlib
import inspect
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
FEW = 12


@pytest.fixture
def accuracy(monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    return importlib.import_module("accuracy")


@pytest.mark.parametrize(
    "name", ["angles", "table", "start", "bones", "coverage", "swaps", "useless", "sweep", "views"]
)
def test_every_measure_gives_a_table_of_at_most_110_characters(accuracy, capsys, name):
    function = accuracy.MEASURES[name]
    known = inspect.signature(function).parameters
    options = {"poses": FEW, "fast": True}
    figures = function(**{option: value for option, value in options.items() if option in known})
    assert figures["rows"]
    accuracy.report.show(figures)
    # The last line repeats the command, however long.
    assert max(len(line) for line in capsys.readouterr().out.splitlines()[:-1]) <= 110


def test_coverage_on_real_labels_counts_their_errors(accuracy, capsys):
    if not importlib.import_module("scenarios").MVOR.is_file():
        pytest.skip("needs ../shared/data/mvor")
    figures, exact = (accuracy.coverage_real(poses=FEW, label_sigma_mm=sigma) for sigma in (30.0, 0.0))
    accuracy.report.show(figures)
    assert max(len(line) for line in capsys.readouterr().out.splitlines()[:-1]) <= 110
    everywhere, alone = figures["rows"]["MVOR, all"], exact["rows"]["MVOR, all"]
    for k in (1, 2, 3):
        assert everywhere[f"error bar {k} σ"] > everywhere[f"scatter {k} σ"] > alone[f"scatter {k} σ"]


def test_people_are_found_on_mvor(accuracy, capsys):
    if not importlib.import_module("scenarios").MVOR.is_file():
        pytest.skip("needs ../shared/data/mvor")
    figures = accuracy.mvor_people()
    accuracy.report.show(figures)
    assert max(len(line) for line in capsys.readouterr().out.splitlines()[:-1]) <= 110
    for detector in ("openpose", "openpose_ms", "rtpose"):
        row = figures["rows"][f"{detector}, track"]
        assert row["recall %"] > 94
        assert row["precision %"] > 72
        assert row["confirmed %"] > 82
        assert row["mixed %"] < 8
        assert row["mean mm"] < 1.05 * row["oracle"]


def test_the_same_seed_gives_the_same_figures(accuracy):
    once, again = (accuracy.table(poses=FEW, fast=True)["rows"] for _ in range(2))
    assert once == again


def test_settings_are_read_as_what_they_look_like(accuracy):
    texts = ["a=1", "b=0.5", "c=true", "d=none", "e=adam"]
    assert dict(map(accuracy.parsed, texts)) == {"a": 1, "b": 0.5, "c": True, "d": None, "e": "adam"}
