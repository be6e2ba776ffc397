"""The published tables that ship as data."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import skelsplat as sk
from skelsplat.evaluation.reported import _load, labels, reported

PAPER_TABLES = (
    "tab:h36m",
    "tab:generalization-h36m-cmu",
    "tab:cmu",
    "tab:h36m-occ",
    "tab:occ-pers",
    "tab:abl-encoding",
    "tab:abl-accumulation",
    "tab:abl-views",
    "tab:abl-initial-guess",
    "tab:abl-noise",
    "tab:abl-symmetry",
    "tab:abl-resolution",
    "tab:abl-covariance",
)
REFERENCES = {"skelsplat": "SkelSplat"}
TABLE = {
    "label": "x",
    "title": "t",
    "source": "s",
    "dataset": "human36m",
    "metric": "m",
    "unit": "mm",
    "columns": ["A", "B"],
    "keys": ["a", "b"],
    "notes": [],
    "rows": [{"method": "M", "citation": "skelsplat", "truth_3d": False, "values": [1, None]}],
}


def test_every_table_of_the_paper_is_there() -> None:
    assert set(PAPER_TABLES) <= set(labels())


@pytest.mark.parametrize(
    ("label", "method", "detector", "setting", "key", "value"),
    [
        ("tab:h36m", "SkelSplat", "resnet152", {}, "average", 20.3),
        ("tab:h36m", "SkelSplat", "metrabs", {}, "WalkTogether", 28.7),
        ("tab:h36m", "Tome et al.", None, {}, "SittingDown", 95.2),
        ("tab:h36m", "AdaFuse", None, {}, "Directions", None),
        ("tab:generalization-h36m-cmu", "SkelSplat", "resnet152", {}, "improvement_percent", 47.8),
        ("tab:cmu", "SkelSplat", "metrabs", {}, "average", 20.9),
        ("tab:h36m-occ", "Alg. Triangulation", "resnet152", {}, "3-hard", 120.4),
        ("tab:occ-pers", "SkelSplat", "resnet50", {}, "4", 40.3),
        ("tab:abl-encoding", "SkelSplat", "metrabs", {}, "rgb", 29.4),
        ("tab:abl-accumulation", "SkelSplat", "resnet152", {}, "1", 23.0),
        ("tab:abl-views", "SkelSplat", "metrabs", {}, "7", 15.7),
        ("tab:abl-initial-guess", "SkelSplat", "cpn", {"init": "fusion"}, "guess", 40.2),
        ("tab:abl-noise", "SkelSplat", "resnet152", {}, "100", 83.6),
        ("tab:abl-resolution", "SkelSplat", "metrabs", {}, "25", 27.5),
        ("tab:abl-symmetry", "SkelSplat", "resnet152", {"dataset": "human36m-occ-3"}, "2", 26.0),
        ("tab:abl-symmetry:seconds", "SkelSplat", None, {}, "3", 0.056),
        ("tab:abl-covariance", "SkelSplat", "resnet152", {"dataset": "human36m-occ-2"}, "2", 54.3),
        ("text:coverage", "SkelSplat", None, {}, "1", 57.2),
        ("iskakov:h36m", "RANSAC", None, {}, "root_relative", 27.4),
        ("adafuse:occlusion-person", "AdaFuse", None, {}, "8", 12.56),
        ("xrmocap:campus", "MVPose", None, {}, "pcp", 92.87),
    ],
)
def test_values_are_the_published_ones(
    label: str, method: str, detector: str | None, setting: dict[str, str], key: str, value: float | None
) -> None:
    assert reported(label).one(method, detector=detector, **setting).value(key) == value


def test_rows_say_whether_they_were_trained_with_3d_truth() -> None:
    table = reported("tab:h36m")
    assert len(table.rows) == 17
    assert sum(row.truth_3d is True for row in table) == 9
    assert "ICCV 2019" in table.select("Iskakov et al. - Vol")[0].citation


def test_unknown_label_column_and_row_are_named() -> None:
    with pytest.raises(sk.InvalidInputError, match=r"label: expected one of tab:abl-accumulation.*'tab:x'"):
        reported("tab:x")
    with pytest.raises(sk.InvalidInputError, match=r"key: expected one of 4, 5.*'9'"):
        reported("tab:abl-views").rows[0].value("9")
    with pytest.raises(sk.InvalidInputError, match=r"tab:h36m: expected one row .*got 3"):
        reported("tab:h36m").one("SkelSplat")


def broken(name: str, value: object) -> dict[str, object]:
    """Change one field of the table, or of its row if the name begins with a dot."""
    if name.startswith("."):
        return {**TABLE, "rows": [{**TABLE["rows"][0], name[1:]: value}]}  # type: ignore[index]
    return {**TABLE, name: value}


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("unit", None, "table.json: unit: expected a text, got None"),
        ("keys", ["a"], "table.json: keys: expected 2 as columns, got 1"),
        ("rows", [], "table.json: rows: expected a list of at least one row"),
        (".values", [1], r"table.json: rows\[0\].values: expected 2 numbers, got \[1\]"),
        (".values", [1, "2"], r"table.json: rows\[0\].values\[1\]: expected a number or null, got '2'"),
        (".citation", "nobody", r"table.json: rows\[0\].citation: expected a key of references.json"),
        (".truth_3d", "yes", r"table.json: rows\[0\].truth_3d: expected true, false or null"),
        (".setting", [], r"table.json: rows\[0\].setting: expected an object of texts"),
    ],
)
def test_errors_name_file_and_field(tmp_path: Path, name: str, value: object, message: str) -> None:
    path = tmp_path / "table.json"
    path.write_text(json.dumps(TABLE), encoding="utf-8")
    assert _load.read_table(path, REFERENCES).rows[0].value("a") == 1.0
    path.write_text(json.dumps(broken(name, value)), encoding="utf-8")
    with pytest.raises(sk.DatasetError, match=message):
        _load.read_table(path, REFERENCES)
