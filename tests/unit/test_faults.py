"""The list of planted faults fits the source: every text stands in one place, every finder exists."""

from __future__ import annotations

from pathlib import Path

import faults
from planted import FAULTS

ROOT = Path(__file__).parents[2]
CORE_TESTS = ROOT / "crates" / "skelsplat-tests" / "suite"


def test_every_fault_has_its_place() -> None:
    for fault in FAULTS:
        path = faults.place_of(fault, ROOT)
        assert fault.new != fault.old, fault.name
        assert path.suffix in (".py", ".rs", ".js")


def test_every_finder_exists() -> None:
    for finder in {finder for fault in FAULTS for finder in fault.finders}:
        name = finder.split()[-1].removesuffix("::")
        here = (ROOT / name, CORE_TESTS / f"{name}.rs", CORE_TESTS / name / "mod.rs")
        assert name == "--lib" or any(path.is_file() for path in here), finder
