"""The published tables that ship as data."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import skelsplat as sk
from skelsplat.evaluation import reported as reported_package
from skelsplat.evaluation.reported import reported

FOLDER = Path(reported_package.__file__).parent
FILES = sorted(path for path in FOLDER.glob("*.json") if path.name != "references.json")


@pytest.mark.parametrize(
    ("label", "method", "detector", "setting", "key", "value"),
    [
        ("tab:h36m", "SkelSplat", "resnet152", {}, "average", 20.3),
        ("tab:h36m", "AdaFuse", None, {}, "Directions", None),
        ("tab:h36m-occ", "Alg. Triangulation", "resnet152", {}, "3-hard", 120.4),
        ("tab:abl-initial-guess", "SkelSplat", "cpn", {"init": "fusion"}, "guess", 40.2),
        ("tab:abl-symmetry", "SkelSplat", "resnet152", {"dataset": "human36m-occ-3"}, "2", 26.0),
        ("tab:abl-symmetry:seconds", "SkelSplat", None, {}, "3", 0.056),
        ("text:coverage", "SkelSplat", None, {}, "1", 57.2),
        ("xrmocap:campus", "MVPose", None, {}, "pcp", 92.87),
    ],
)
def test_values_are_the_published_ones(
    label: str, method: str, detector: str | None, setting: dict[str, str], key: str, value: float | None
) -> None:
    (row,) = (
        row
        for row in reported(label).rows
        if row.method == method
        and detector in (None, row.detector)
        and setting.items() <= row.setting.items()
    )
    assert row.cells([key]) == (value,)


def test_an_unknown_label_is_named() -> None:
    with pytest.raises(sk.InvalidInputError, match="label"):
        reported("tab:x")


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_files_are_whole(path: Path) -> None:
    """What the package reads without checking: texts, numbers or null, and citations that exist."""
    references = json.loads((FOLDER / "references.json").read_text(encoding="utf-8"))
    content = json.loads(path.read_text(encoding="utf-8"))
    texts = [content[name] for name in ("label", "title", "source", "dataset", "metric", "unit")]
    texts += [text for name in ("columns", "keys", "notes") for text in content[name]]
    assert all(isinstance(text, str) for text in texts)
    assert len(content["keys"]) == len(content["columns"])
    assert content["rows"]
    for row in content["rows"]:
        assert isinstance(row["method"], str)
        assert isinstance(references[row["citation"]], str)
        assert len(row["values"]) == len(content["keys"])
        assert {type(value) for value in row["values"]} <= {int, float, type(None)}
        assert row["truth_3d"] in (True, False, None)
        assert all(isinstance(row.get(name), str | None) for name in ("detector", "training"))
        assert all(isinstance(value, str) for value in row.get("setting", {}).values())
