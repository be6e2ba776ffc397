"""Documents of JSON in which a number that does not exist is null."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np


def to_text(document: Any) -> str:
    """Return a document as JSON text, with a final line break."""
    return json.dumps(plain(document), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


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
