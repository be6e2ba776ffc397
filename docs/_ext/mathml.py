"""Mathematics as MathML, generated when the site is built: no scripts and no external fonts."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from latex2mathml.converter import convert

if TYPE_CHECKING:
    from docutils import nodes
    from sphinx.application import Sphinx
    from sphinx.writers.html5 import HTML5Translator

# capital Greek letters are upright, as in LaTeX
_UPRIGHT = re.compile(r"<mi>(&#x0039[1-9A-F];|&#x003A[0-9];)</mi>")


def visit_inline(self: HTML5Translator, node: nodes.math) -> None:
    self.body.append(_mathml(node.astext(), "inline"))
    raise _skip()


def visit_block(self: HTML5Translator, node: nodes.math_block) -> None:
    self.body.append(f'<div class="math">{_mathml(node.astext(), "block")}</div>')
    raise _skip()


def _mathml(latex: str, display: str) -> str:
    """Return MathML; refuse unknown macros, which would be shown as text."""
    made = convert(" ".join(latex.split()), display=display)
    if unknown := re.findall(r"<m[a-z]+[^>]*>\\[A-Za-z]+", made):
        raise ValueError(f"mathematics: {latex!r}: {unknown[0]} is not known")
    return _UPRIGHT.sub(r'<mi mathvariant="normal">\1</mi>', made)


def _skip() -> Exception:
    from docutils.nodes import SkipNode

    return SkipNode()


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_html_math_renderer("mathml", (visit_inline, None), (visit_block, None))
    app.config.html_math_renderer = "mathml"
    return {"parallel_read_safe": True, "parallel_write_safe": True}
