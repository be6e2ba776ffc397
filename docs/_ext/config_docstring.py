"""Sentences between the parameters of ``RefineConfig``, as entries of their own.

Its docstring groups the settings by method with lines such as "Of Adam, the paper's method; Gauss–Newton uses
none of them:", which numpydoc would take for a parameter of that name.
"""

from __future__ import annotations

from typing import Any

from sphinx.application import Sphinx


def split(_app: Sphinx, _what: str, name: str, _obj: Any, _options: Any, lines: list[str]) -> None:
    """Turn "A; B:" into the entry A with the description B."""
    if name != "skelsplat.RefineConfig":
        return
    out: list[str] = []
    pending: list[str] = []
    for line in lines:
        if pending or line.startswith("Of "):
            pending.append(line)
            if line.endswith(":"):
                heading, _, rest = " ".join(pending).rstrip(":").partition("; ")
                out += [heading, f"    {rest}."]
                pending = []
            continue
        out.append(line)
    lines[:] = out


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("autodoc-process-docstring", split, priority=100)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
