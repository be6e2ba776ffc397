"""Imports inside the package point one way (ARCHITECTURE.md)."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[2] / "python" / "skelsplat"

# Part of the package → what it must not import. `skelsplat` itself re-exports `_refine`.
FORBIDDEN = {
    "evaluation": ("cli", "viz"),
    "temporal": ("cli", "viz", "io", "_refine", "association", "synthetic", "metrics", "evaluation"),
    "_arrays": (
        "cli",
        "viz",
        "io",
        "_refine",
        "_skelsplat",
        "association",
        "synthetic",
        "metrics",
        "evaluation",
    ),
    "_optional": ("cli", "viz", "io", "_refine", "association", "synthetic", "metrics", "evaluation"),
    "_opencv": ("cli", "viz", "io", "_refine", "association", "synthetic", "metrics", "evaluation"),
    # `datasets` writes the sets that `synthetic` makes
    "datasets": ("cli", "viz", "_refine", "association", "metrics", "evaluation"),
    "viz": ("cli", "io", "association", "synthetic", "_refine", "_skelsplat", "evaluation"),
    "findings": (
        "cli",
        "viz",
        "io",
        "_refine",
        "_skelsplat",
        "association",
        "synthetic",
        "evaluation",
        "run",
    ),
    "_sentences": ("cli", "viz", "io", "_refine", "_skelsplat", "association", "synthetic", "evaluation"),
    "run": ("cli", "evaluation", "datasets"),
    "rig_check": ("cli", "viz", "io", "synthetic", "evaluation"),
    "io": ("cli", "viz", "_refine", "synthetic", "evaluation", "temporal"),
    "synthetic": ("cli", "viz", "io", "_refine", "association", "evaluation", "datasets"),
    "metrics": ("cli", "viz", "io", "_refine", "association", "synthetic", "evaluation"),
    "association": ("cli", "viz", "_refine", "evaluation"),
    "_refine": ("cli", "viz", "io", "association", "synthetic", "metrics", "evaluation"),
    "cameras": ("cli", "viz", "io", "association", "synthetic", "metrics", "_refine", "evaluation"),
    "layouts": ("cli", "viz", "io", "association", "synthetic", "metrics", "_refine", "evaluation"),
    "exceptions": (
        "cli",
        "viz",
        "io",
        "association",
        "synthetic",
        "metrics",
        "_refine",
        "_skelsplat",
        "evaluation",
    ),
}


def files(part: str) -> list[Path]:
    folder = PACKAGE / part
    return sorted(folder.rglob("*.py")) if folder.is_dir() else [folder.with_suffix(".py")]


def imported(path: Path) -> set[str]:
    """First-level parts of the package that a file imports."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        if isinstance(node, ast.ImportFrom) and node.module:
            names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
        found |= {name.split(".")[1] for name in names if name.startswith("skelsplat.")}
    return found


@pytest.mark.parametrize("part", FORBIDDEN)
def test_imports_point_one_way(part: str) -> None:
    for path in files(part):
        assert not imported(path) & set(FORBIDDEN[part]), path.relative_to(PACKAGE)


def test_optional_packages_are_not_imported_with_the_package() -> None:
    optional = (
        "scipy",
        "ezc3d",
        "xarray",
        "h5py",
        "h5netcdf",
        "pandas",
        "cv2",
        "PIL",
        "matplotlib",
        "plotly",
    )
    program = (
        "import sys, skelsplat, skelsplat.io, skelsplat.temporal, skelsplat.cli, skelsplat.run\n"
        f"print(*(name for name in {optional} if name in sys.modules))"
    )
    run = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True)
    assert run.stdout.split() == []


HEAVY = {
    "matplotlib",
    "scipy",
    "cv2",
    "pandas",
    "tables",
    "h5py",
    "xarray",
    "h5netcdf",
    "ezc3d",
    "plotly",
    "PIL",
}
HEAVY |= {"typer", "click", "rich", "tomli", "tomllib", "json", "multiprocessing", "asyncio"}
PARTS = ("io", "cli", "viz", "datasets", "evaluation", "rig_check", "association", "temporal")


def test_the_package_brings_only_numpy_and_what_it_computes_with() -> None:
    # what it takes is measured by benchmarks/imports.py
    program = [sys.executable, "-X", "importtime", "-c", "import skelsplat"]
    said = subprocess.run(program, check=True, capture_output=True, text=True).stderr.splitlines()
    names = {line.rpartition("|")[2].strip() for line in said if line.startswith("import time:")}
    assert {"numpy", "skelsplat", "skelsplat._skelsplat"} <= names
    assert not {name.partition(".")[0] for name in names} & HEAVY
    assert not names & {f"skelsplat.{part}" for part in PARTS}


def test_the_compiled_core_knows_no_python() -> None:
    manifest = (PACKAGE.parents[1] / "crates" / "skelsplat-core" / "Cargo.toml").read_text(encoding="utf-8")
    assert "pyo3" not in manifest
    assert "numpy" not in manifest
