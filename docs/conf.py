"""Sphinx settings of the documentation: ``sphinx-build -W -n --keep-going docs site``.

The site needs no network, neither to be built nor to be read: mathematics becomes MathML at build time, and
theme, styles and scripts are files of the site.
"""

from __future__ import annotations

import sys
from pathlib import Path

import skelsplat

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "_ext"))

project = "SkelSplat"
author = "the SkelSplat authors"
project_copyright = author
version = release = skelsplat.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "numpydoc",
    "sphinx_copybutton",
    "sphinx_design",
    "mathml",
    "commands",
]
exclude_patterns = ["_ext", "figures"]
nitpicky = True  # nothing is left out
smartquotes = False  # they would turn --option into –option
highlight_language = "none"

html_theme = "furo"
html_title = f"SkelSplat {version}"
html_static_path = ["_static"]
html_css_files = ["skelsplat.css"]
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {"navigation_with_keys": True}
templates_path: list[str] = []

myst_enable_extensions = ["amsmath", "attrs_inline", "colon_fence", "deflist", "dollarmath", "fieldlist"]
myst_heading_anchors = 3
myst_links_external_new_tab = False

# a console block's prompt and output stay behind when it is copied
copybutton_prompt_text = "$ "
copybutton_only_copy_prompt_lines = True

autodoc_member_order = "bysource"
# Types are in the docstrings, with shapes; hints would only repeat them in longer words.
autodoc_typehints = "none"
autodoc_preserve_defaults = True
numpydoc_show_class_members = False
numpydoc_attributes_as_param_list = True
numpydoc_xref_param_type = False
