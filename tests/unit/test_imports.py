"""Imports inside the package point one way (ARCHITECTURE.md)."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

from import_circles import circle, python_graph, rust_graph

PACKAGE = Path(__file__).parents[2] / "python" / "skelsplat"

# From the top: a part imports those below it, and none beside it. `skelsplat` itself re-exports `_refine`.
LAYERS = (
    {"app"},
    {"cli"},
    {"run", "evaluation"},
    {"detect"},
    {"datasets"},  # writes the sets that `synthetic` makes
    {"io", "viz", "rig_check", "synthetic"},
    {"association", "temporal"},
    {"_people"},
    {"_sequence", "_angles", "_rig", "_calibrate", "_skeleton"},
    {"_placing"},
    {"_who"},
    {"_refine", "metrics", "_start", "_world"},
    {"cameras", "layouts", "_frozen"},
    {"findings"},
    {"_clocks"},
    {"_skelsplat"},
    {"_lock", "_fields"},
    {"_budget"},
    {"_arrays", "_atomic"},
    {"_optional"},
    {"exceptions", "_json", "_words"},
    {"_escape"},
)
HEAVY = {
    *(
        "matplotlib",
        "plotly",
        "scipy",
        "cv2",
        "PIL",
        "pandas",
        "xarray",
        "h5py",
        "h5netcdf",
        "ezc3d",
        "tables",
    ),
    *("mediapipe", "rtmlib", "typer", "click", "rich", "json", "tomllib", "tomli", "multiprocessing"),
    *("asyncio", "nicegui", "fastapi", "uvicorn"),
}
# Part → what it must not import either, though it is below it.
FORBIDDEN = {
    "run": ("datasets",),
    "datasets": ("viz", "_refine", "association", "metrics"),
    "io": ("_refine", "temporal"),
    "viz": ("association", "temporal", "_refine", "metrics", "cameras", "layouts", "findings", "_skelsplat"),
    "rig_check": ("temporal", "_refine"),
    "synthetic": ("_refine", "association"),
    "association": ("_refine",),
    "temporal": ("_refine", "metrics", "cameras", "layouts", "_skelsplat"),
    "findings": ("_skelsplat",),
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


def test_every_part_has_its_layer() -> None:
    parts = {path.name.partition(".")[0] for path in PACKAGE.iterdir() if path.name.endswith(".py")}
    parts |= {path.parent.name for path in PACKAGE.glob("*/__init__.py")} | {"_skelsplat"}
    assert sorted(part for layer in LAYERS for part in layer) == sorted(
        parts - {"__init__", "__main__", "data"}
    )


@pytest.mark.parametrize("part", sorted(set().union(*LAYERS) - {"_skelsplat"}))
def test_imports_point_one_way(part: str) -> None:
    level = next(k for k, layer in enumerate(LAYERS) if part in layer)
    not_below = set().union(*LAYERS[: level + 1]) - {part}
    for path in files(part):
        assert not imported(path) & {*not_below, *FORBIDDEN.get(part, ())}, path.relative_to(PACKAGE)


def test_optional_packages_are_not_imported_with_the_package_and_parts_not_with_the_command_line() -> None:
    optional = HEAVY - {"typer", "click", "rich", "json", "tomllib", "tomli", "multiprocessing", "asyncio"}
    program = (
        "import sys, typer, skelsplat.cli\n"
        "early = {name for name in sys.modules if name.startswith(('skelsplat.io', 'skelsplat.run'))}\n"
        "typer.main.get_command(skelsplat.cli.app).commands\n"
        "import skelsplat.io, skelsplat.temporal, skelsplat.run\n"
        f"print(*early, *(name for name in {optional} if name in sys.modules))"
    )
    run = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True)
    assert run.stdout.split() == []


PARTS = ("io", "cli", "viz", "datasets", "evaluation", "rig_check", "association", "temporal")


def imported_by(statement: str) -> set[str]:
    program = [sys.executable, "-X", "importtime", "-c", statement]
    said = subprocess.run(program, check=True, capture_output=True, text=True).stderr.splitlines()
    return {line.rpartition("|")[2].strip() for line in said if line.startswith("import time:")}


def test_the_package_brings_only_numpy_and_what_it_computes_with() -> None:
    # (old NumPy brings json itself)
    names = imported_by("import numpy, skelsplat") - imported_by("import numpy")
    assert {"skelsplat", "skelsplat._skelsplat"} <= names
    assert not {name.partition(".")[0] for name in names} & HEAVY
    assert not names & {f"skelsplat.{part}" for part in PARTS}


# no part imports itself through others


# What each layer of the core may import besides what stands before it in this list.
CORE_LAYERS = [
    {"error"},
    {"memory", "settings", "threads", "matrix3", "names", "statistics"},
    {"camera", "layout"},
    {"detections", "unit", "gaussian", "overlap", "projection", "symmetry", "outcome", "bones"},
    {"triangulate"},
    {"annealed", "paper"},
    {"refine", "triangulation"},
    {"batch"},
    {"sequence"},
    {"follow", "people", "rig"},
]


@pytest.mark.parametrize("graph", [rust_graph, python_graph])
def test_there_is_no_circle(graph) -> None:
    assert circle(graph()) == []


def test_the_parts_of_the_core_import_one_way() -> None:
    place = {name: level for level, names in enumerate(CORE_LAYERS) for name in names}
    imports = {
        (module[0], other[0])
        for module, others in rust_graph().items()
        for other in others
        if module and other and module[0] != other[0] and module[0] != "testing"
    }
    assert ("refine", "annealed") in imports
    assert {name for pair in imports for name in pair} <= set(place)
    assert {(a, b) for a, b in imports if place[b] >= place[a]} == set()
