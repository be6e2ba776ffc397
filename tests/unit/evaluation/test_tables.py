"""What is printed and written of an evaluation."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

import skelsplat as sk
import takes
from skelsplat.datasets import Dataset
from skelsplat.evaluation import methods, protocols, single
from skelsplat.evaluation import reported as reported_package
from skelsplat.evaluation.reported import published, reported
from skelsplat.evaluation.tables import Column, Row, Table

OVER_TIME = ["annealed-butterworth", "over-time"]
NAMES = ["dlt", "fusion", "annealed"]
DATA = takes.simulated(4, keys=("S9/Walking", "S9/Greeting", "S11/Directions 1"))


@pytest.fixture(scope="module")
def evaluation() -> single.Single:
    return single.evaluate(DATA, NAMES)


def by_hand() -> Table:
    columns = (Column("low", best="low"), Column("high", 2, best="high"), Column("text"))
    rows = (
        Row("a", (1.04, 3.0, "x|y")),
        Row("b", (1.01, None, "z")),
        Row("c", (2.0, 1.0, "z")),
        Row("d", (0.1, None, None), "reported"),
    )
    return Table("Title", "method", columns, rows, ("A note.",))


def test_markdown_of_a_table() -> None:
    assert by_hand().markdown() == (
        "### Title\n\n"
        "| method | low | high | text |\n"
        "| --- | ---: | ---: | ---: |\n"
        "| a | **1.0** | **3.00** | x\\|y |\n"  # as good as b once printed
        "| b | **1.0** | – | z |\n"
        "| c | 2.0 | 1.00 | z |\n"
        "| *d* | 0.1 | – | – |\n"
        "\nA note.\n"
    )


def test_actions_are_in_the_paper_s_order_beside_its_rows(evaluation: single.Single) -> None:
    table = evaluation.report().tables[1]
    assert [column.header for column in table.columns] == ["Dir.", "Greet", "Walk", "Avg"]
    assert table.rows[0].cells[0] == evaluation.figures("dlt", "action", "Directions")["absolute_mm"]
    assert table.rows[0].cells[3] == evaluation.figures("dlt")["absolute_mm"]
    assert table.text(table.rows[0], 1) == "–"  # S9 Greeting does not count here
    metrabs = next(row for row in table.rows if row.name == "SkelSplat (metrabs)")
    assert metrabs.cells == (24.4, 25.0, 28.1, 26.7)
    relative = evaluation.report().tables[2]
    assert not any(row.origin != "measured" for row in relative.rows)
    assert relative.rows[0].cells[1] == evaluation.figures("dlt", "action", "Greeting")["relative_mm"]


@pytest.mark.parametrize(
    ("name", "n_views", "row", "value"),
    [
        ("human36m-like-occ-3-hard", None, "SkelSplat (metrabs)", 38.1),
        ("occlusion-person-like", 4, "SkelSplat (resnet50)", 40.3),
        ("dome", 6, "SkelSplat (metrabs)", 14.7),
    ],
)
def test_the_published_figures_are_those_of_the_same_setting(name, n_views, row, value) -> None:
    data = sk.synthetic.simulate_set(name, poses=60)
    rig = data.rigs[data.recordings[0].rig_name]
    take = takes.hand_made("S9/Eating", rig=rig, n_joints=data.layout.n_joints)
    rules = protocols.get(name).with_options(n_views=n_views)
    found = published(Dataset(name, data.layout, (take,)), rules)
    assert {r.name: r.cells[0] for r in found.rows([found.absolute])}[row] == value


def test_shelf_has_pcp_per_actor() -> None:
    made = []
    for k in range(2):
        take = takes.hand_made(f"S0/actor{k}", frames=range(300, 303), n_joints=14, action=f"actor{k}")
        noise = sk.synthetic.DetectionNoise()
        seen = sk.synthetic.simulate_detections(take.truth, take.rig, noise=noise, layout=None)
        made.append(replace(take, detections=seen))
    found = single.evaluate(Dataset("shelf", sk.layouts.SHELF14, tuple(made)), ["dlt", "ransac"])
    table = found.methods_table()
    pcp = [column.header for column in table.columns].index("PCP")
    assert table.rows[0].cells[pcp] == 100 * found.figures("dlt")["pcp"]
    mvpose = table.rows[-1]
    assert (mvpose.name, mvpose.cells[0], mvpose.cells[pcp]) == ("MVPose", 55.3, 95.82)
    actors = found.report().tables[2]
    assert [column.header for column in actors.columns] == ["Actor 0", "Actor 1", "Avg"]
    line = found.report().csv().splitlines()[-1].split(",")
    assert dict(zip(single.CSV_FIELDS, line, strict=True))["pcp"] == "0.9582"


def test_without_names_everything_runs_that_the_data_allow(monkeypatch: pytest.MonkeyPatch) -> None:
    blind = replace(DATA, takes=tuple(replace(take, monocular=None) for take in DATA))
    run = single.evaluate(blind)
    told = " ".join(run.methods_table().notes)
    assert all(f"{name}, which needs {words}" in told for name, words in run.left_out.items())
    assert run.left_out
    found = list(run.methods)
    lacking = {"fusion", "annealed-prior", "paper", "paper-ransac", *OVER_TIME}
    assert found == [name for name in methods.names if name not in lacking]
    rules = protocols.get(DATA.name)
    assert set(OVER_TIME) < set(single.evaluate(takes.recording()).methods)
    monkeypatch.setattr(single, "find_spec", lambda name: None if name == "scipy" else name)
    without, lacking = single.select([], rules.cases(takes.recording()), methods.Options())
    assert "annealed-butterworth" not in {method.name for method in without}
    assert lacking["annealed-butterworth"] == "the package scipy"
    with pytest.raises(sk.InvalidInputError, match="methods: expected takes with detections"):
        single.evaluate(replace(blind, takes=tuple(replace(t, detections=None) for t in blind)))


# the published tables that ship as data


FOLDER = Path(reported_package.__file__).parent
FILES = sorted(path for path in FOLDER.glob("*.json") if path.name != "references.json")


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
