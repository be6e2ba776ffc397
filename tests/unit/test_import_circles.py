"""No part of the core or of the package imports itself through others."""

from __future__ import annotations

import pytest

from import_circles import circle, python_graph, rust_graph

# What each layer of the core may import besides what stands before it in this list.
LAYERS = [
    {"error"},
    {"memory", "camera", "layout", "settings", "threads", "matrix3", "names", "statistics"},
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
    place = {name: level for level, names in enumerate(LAYERS) for name in names}
    imports = {
        (module[0], other[0])
        for module, others in rust_graph().items()
        for other in others
        if module and other and module[0] != other[0] and module[0] != "testing"
    }
    assert ("refine", "annealed") in imports
    assert {name for pair in imports for name in pair} <= set(place)
    assert {(a, b) for a, b in imports if place[b] >= place[a]} == set()
