"""What an installed package has to carry."""

from __future__ import annotations

import ast
import inspect
import json
import re
import shutil
import subprocess
import sys
from importlib import metadata, resources
from pathlib import Path

import numpy as np
import pytest

import skelsplat
from command_line import FAST, READ, RESULTS, assert_fails, invoke, read_report, succeed
from skelsplat import _optional, _skelsplat
from skelsplat.io import read_calibration, read_detections, sample

ROOT = Path(__file__).parents[2]


def test_types_and_licences_are_beside_the_code() -> None:
    there = {path.name for path in resources.files("skelsplat").joinpath("data").iterdir()}
    assert {"LICENSE.pose2sim", "NOTICE.pose2sim"} <= there
    assert all(resources.files("skelsplat").joinpath(name).is_file() for name in ("py.typed", STUB.name))


def test_one_version() -> None:
    assert skelsplat.__version__ == metadata.version("skelsplat")


def notices() -> set[tuple[str, str]]:
    text = (ROOT / "licenses/third-party.yml").read_text(encoding="utf-8")
    return set(re.findall(r"^- package_name: (\S+)\n  package_version: (\S+)$", text, re.MULTILINE))


def components() -> set[tuple[str, str]]:
    document = json.loads((ROOT / "licenses/skelsplat.cdx.json").read_text(encoding="utf-8"))
    return {(one["name"], one["version"]) for one in document["components"]}


@pytest.mark.skipif(shutil.which("cargo") is None, reason="cargo tells what the compiled module consists of")
@pytest.mark.parametrize("listed", [notices, components])
def test_notices_and_the_bill_of_materials_list_what_is_compiled(listed) -> None:
    """If they do not, run `make notices`."""
    locked = (ROOT / "Cargo.lock").read_text(encoding="utf-8")
    known = set(re.findall(r'^name = "(.+)"\nversion = "(.+)"$', locked, re.MULTILINE))
    tree = ["cargo", "tree", "--locked", "--package", "skelsplat-py", "--edges", "normal", "--prefix", "none"]
    shown = subprocess.run(tree, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    compiled = set(re.findall(r"^(\S+) v(\S+)", shown, re.MULTILINE))
    ours = {"skelsplat-core", "skelsplat-py"}
    assert {(name, version) for name, version in compiled if name not in ours} <= listed() <= known


def test_every_licence_text_is_there() -> None:
    assert "NOT FOUND" not in (ROOT / "licenses/third-party.yml").read_text(encoding="utf-8")


# extras


PICTURES = {"overview.png", "weights.png", "report.html"}
NEEDS = "report.html and figures need skelsplat[viz]: pip install 'skelsplat[viz]'"
EXTRAS = {"all", "app", "evaluation", "formats", "mediapipe", "rtmlib", "temporal", "video", "viz"}


@pytest.fixture
def without_viz(monkeypatch):
    for module in _optional.DRAWING:
        monkeypatch.setitem(sys.modules, module, None)


@pytest.mark.usefixtures("without_viz")
def test_a_run_without_a_package_for_pictures_writes_all_else_and_says_so(arguments):
    result = succeed(*arguments, *READ, *FAST)
    assert f"note: {NEEDS}\n" in result.stderr
    out = Path(arguments[-1])
    names = {path.name for path in out.iterdir()}
    assert names >= RESULTS - PICTURES
    assert not names & PICTURES
    assert "overview.png" not in result.stdout
    report = json.loads((out / "report.json").read_text())
    assert [found["text"] for found in report["findings"] if found["kind"] == "no_pictures"] == [NEEDS]
    assert not {*report["files"]} & PICTURES


@pytest.mark.usefixtures("without_viz")
def test_plot_without_viz_fails_with_the_pip_line(finished_run):
    assert_fails(invoke("plot", finished_run), 1, "pip install 'skelsplat[viz]'")
    assert not (finished_run / "plots").exists()


def test_every_extra_that_a_message_names_exists_and_is_part_of_all():
    root = Path(__file__).parents[2]
    project = (root / "pyproject.toml").read_text(encoding="utf-8")
    assert 'all = ["skelsplat[app,evaluation,formats,temporal,video,viz]"]' in project
    for extra in EXTRAS:
        assert f"\n{extra} = [" in project
    assert '[all]"' in (root / "Makefile").read_text(encoding="utf-8")


# what help() shows


STUB = Path(__file__).parents[2] / "python" / "skelsplat" / "_skelsplat.pyi"


def documented() -> dict[str, str]:
    """Docstrings of the stub's functions, classes and members, by dotted name."""
    found = {}
    for node in ast.parse(STUB.read_text(encoding="utf-8")).body:
        members = [node, *node.body] if isinstance(node, ast.ClassDef) else [node]
        for member in members:
            if isinstance(member, ast.FunctionDef | ast.ClassDef) and (text := ast.get_docstring(member)):
                name = member.name if member is node else f"{node.name}.{member.name}"
                found[name] = text
    return found


DOCUMENTED = documented()


@pytest.mark.parametrize("name", DOCUMENTED)
def test_runtime_text_is_the_stubs(name: str) -> None:
    thing = _skelsplat
    for part in name.split("."):
        thing = getattr(thing, part)
    shown = (inspect.getdoc(thing) or "").strip()
    assert shown == DOCUMENTED[name].strip()


def test_every_public_function_and_class_is_documented() -> None:
    exported = {n for n in skelsplat.__all__ if getattr(skelsplat, n) is getattr(_skelsplat, n, None)}
    assert {name for name in exported if callable(getattr(_skelsplat, name))} <= set(DOCUMENTED)
    functions = [name for name in _skelsplat.__all__ if name[0].islower()]
    assert all(inspect.getdoc(getattr(_skelsplat, name)) for name in functions)


# the recordings that ship


def test_two_people_and_a_bystander(tmp_path):
    paths = sample.extract(tmp_path, people=True)
    rig = read_calibration(paths.calibration, unit=sample.UNIT)
    found = read_detections(paths.detections, rig, layout=sample.LAYOUT)
    assert found.people.shape[0::3] == (100, 25)
    np.testing.assert_array_equal(np.median(found.people_per_frame, axis=0), [3, 3, 2, 2])
    assert {path.name for path in tmp_path.iterdir()} >= {"LICENSE.pose2sim", "NOTICE.pose2sim"}


def test_the_demo_of_several_people(tmp_path, monkeypatch):
    """It has a folder of its own: that of the other demo keeps its files and its input."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "skelsplat-demo").mkdir()
    result = succeed("demo", "--people")
    assert not list((tmp_path / "skelsplat-demo").iterdir())
    tmp_path = tmp_path / "skelsplat-demo-people"
    long = [line for line in result.stdout.splitlines() if len(line) > 80]
    assert all(line.startswith("skelsplat check-cameras ") for line in long)  # a command is one line, to copy
    assert "was added to this recording by calculation" in " ".join(result.stdout.split())
    people = read_report(tmp_path)["people"]
    assert [(one["first_frame"], one["last_frame"], one["views_median"]) for one in people] == [
        *[(0, 99, 4)] * 2,
        (0, 99, 2),
    ]
