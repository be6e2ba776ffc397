"""The list of planted faults fits the source: every text stands in one place, every finder exists."""

from __future__ import annotations

from pathlib import Path

import pytest

import faults
from planted import FAULTS, Fault

ROOT = Path(__file__).parents[2]
CORE_TESTS = ROOT / "crates" / "skelsplat-core" / "tests"


def test_every_fault_has_its_place() -> None:
    for fault in FAULTS:
        path = faults.place_of(fault, ROOT)
        assert fault.new != fault.old, fault.name
        assert path.suffix in (".py", ".rs", ".js")


def test_every_finder_exists() -> None:
    for finder in {finder for fault in FAULTS for finder in fault.finders}:
        *_, name = finder.split()
        here = (ROOT / name, CORE_TESTS / f"{name}.rs", CORE_TESTS / name / "main.rs")
        assert name == "--lib" or any(path.is_file() for path in here), finder


def test_a_fault_is_planted_once(tmp_path: Path) -> None:
    folder = tmp_path / "python" / "skelsplat" / "inner"
    folder.mkdir(parents=True)
    (folder / "a.py").write_text("x = 1\ny = 2\n", encoding="utf-8")
    fault = Fault("it", "kind", "y = 2", "y = 3", ())
    assert faults.plant(fault, tmp_path) == folder / "a.py"
    assert (folder / "a.py").read_text(encoding="utf-8") == "x = 1\ny = 3\n"
    with pytest.raises(SystemExit, match=r"it: expected its text in one place, got it in nowhere"):
        faults.place_of(fault, tmp_path)
    (folder / "a.py").write_text("y = 2\ny = 2\n", encoding="utf-8")
    with pytest.raises(SystemExit, match="in python"):
        faults.place_of(fault, tmp_path)
