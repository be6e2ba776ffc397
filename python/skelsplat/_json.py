"""Documents of JSON in which a number that does not exist is null."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np

from skelsplat._escape import CONTROL


def to_text(document: Any) -> str:
    """Return a document as JSON text, with a final line break; control characters are escaped."""
    lines = json.dumps(plain(document), indent=2, ensure_ascii=False, allow_nan=False).split("\n")
    return "\n".join(CONTROL.sub(lambda found: f"\\u{ord(found[0]):04x}", line) for line in lines) + "\n"


def plain(value: Any) -> Any:
    """Return ``value`` with numbers of NumPy as Python's, and NaN and infinity as None."""
    if isinstance(value, dict):
        return {str(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
