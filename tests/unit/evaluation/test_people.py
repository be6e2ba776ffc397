"""Evaluation of several people: methods, figures, tables, and the command."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest
from typer.testing import CliRunner

from command_line import succeed
from skelsplat import datasets, synthetic
from skelsplat.cli import app
from skelsplat.datasets.synthetic import write_simulated
from skelsplat.evaluation import people
from skelsplat.evaluation.people import Tally
from sweeps import swept
from writers import shelf_campus


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    folder = tmp_path_factory.mktemp("people") / "data"
    write_simulated(folder, synthetic.simulate_people_set(3, 4, 2, frames=60, seed=0))
    return folder


@pytest.fixture(scope="module")
def data(root):
    return datasets.read("synthetic", root)


@pytest.fixture(scope="module")
def found(data):
    return people.evaluate(data)


def test_all_methods_find_the_people(found):
    assert found.methods == ("track", "affinity", "oracle")
    for method in found.methods:
        figures = found.figures(method)
        assert figures["recall"] > 0.98
        assert figures["precision"] > 0.9
        assert figures["mean_mm"] < 40
    own, other = found.figures("track"), found.figures("affinity")
    assert (own["identity_switches"], own["idf1"]) == (0, 1)
    assert abs(own["change"]) < 0.05 < other["change"]
    assert np.isnan(found.figures("oracle")["change"])


def test_an_exchange_is_a_swap_and_confused_frames_are_not_compared():
    body, frames = synthetic.motion("turn", 40, seed=0), np.arange(40)
    truth = np.stack([body, np.add(body, [2000.0, 0, 0])])
    names = np.where(frames < 10, 0, 1)
    tracks = [
        (int(name), frames[names == k], truth[q][names == k] + [10.0, 0, 0])
        for q in (0, 1)
        for k, name in ((0, q), (1, 1 - q))
    ]
    right = [(q, frames, truth[q] + [5.0, 0, 0]) for q in (0, 1)]
    nobody = np.zeros((2, 40), dtype=bool)
    confused, reference = Tally(), Tally()
    for tally, given in ((confused, tracks), (reference, right)):
        tally.add("scene", given, truth, nobody, 0.4, fps=10.0, names=("a", "b"))
    figures = confused.figures(reference)
    assert figures["identity_switches"] == 2
    assert (figures["scenes_swapped"], figures["scenes_clean"]) == (1, 0)
    assert figures["mean_mm"] == pytest.approx(10)
    assert figures["change"] == pytest.approx(1.0)
    assert figures["ms_per_frame"] == pytest.approx(10.0)
    assert np.isnan(figures["pcp"])
    kept = confused.scenes["scene"].kept
    assert kept.sum() == 60  # an identity is whose it mostly is


def test_people_are_told_apart_or_given_but_not_both(root, tmp_path):
    def run(*arguments):
        return CliRunner().invoke(app, ["evaluate", "synthetic", str(root), "-o", str(tmp_path), *arguments])

    content = json.loads(run("--json").stdout)
    assert {row["method"] for row in content["figures"]} == set(people.names)
    rows = list(csv.DictReader((tmp_path / "report.csv").read_text(encoding="utf-8").splitlines()))
    assert [row["name"] for row in rows if row["group"] == "person"][:3] == ["person0", "person1", "person2"]
    assert "MPJPE, mm, per person" in run("-m", "track,oracle", "--per-joint").stdout
    alone = json.loads(run("-m", "dlt,annealed", "--json").stdout)
    assert {line["method"] for line in alone["figures"]} == {"dlt", "annealed"}
    assert "--methods" in run("-m", "dlt,track").output


@pytest.mark.parametrize(("name", "form"), [("shelf", "npz"), swept("campus", "pickle")])
def test_shelf_and_campus_without_oracle_association(tmp_path, name, form):
    shelf_campus.write_everybody(tmp_path / "data", name, form=form, n_frames=121)
    command = ["evaluate", name, tmp_path / "data", "-o", tmp_path / "out", "--json"]
    content = json.loads(succeed(*command).stdout)
    figures = {(row["method"], row["name"]): row for row in content["figures"]}
    for actor in ("", "actor0", "actor1", "actor2"):
        row = figures["track", actor]
        assert row["person_frames"] == 121 * (1 if actor else 3), "actor 3 of Shelf need not be found"
        assert row["pcp"] > 0.98
        assert row["recall"] > 0.98
        assert row["mean_mm"] < 25
    assert figures["track", ""]["precision"] > 0.98
    assert figures["track", ""]["mean_mm"] < figures["affinity", ""]["mean_mm"]
    text = (tmp_path / "out" / "report.md").read_text(encoding="utf-8")
    assert "| Actor 0 | Actor 1 | Actor 2 | all |" in text
    assert "| *MVPose* |" in text
