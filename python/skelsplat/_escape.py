"""Text of files and folders on its way to a terminal."""

from __future__ import annotations

import re

CONTROL = re.compile(
    "["
    "\x00-\x1f\x7f-\x9f"  # of terminals: colours, the cursor, the title, the clipboard
    "\u2028\u2029"  # ends of lines
    "\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069\ufeff"  # the direction of writing
    "\ud800-\udfff"  # bytes of a file name that are no text
    "]"
)
"""A character that a terminal would obey instead of showing it."""


def escaped(text: str) -> str:
    r"""Return one line of text with control characters as Python writes them, ``\x1b`` or ``\n``."""
    return CONTROL.sub(lambda found: found[0].encode("unicode_escape").decode(), text)
