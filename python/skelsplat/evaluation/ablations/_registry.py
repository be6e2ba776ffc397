"""The ablations by name."""

from __future__ import annotations

from skelsplat.evaluation.ablations import (
    accumulation,
    covariance,
    coverage,
    encoding,
    initialisation,
    noise,
    resolution,
    symmetry,
    views,
)
from skelsplat.evaluation.ablations._model import Ablation
from skelsplat.exceptions import InvalidInputError

_ALL: dict[str, Ablation] = {
    module.ABLATION.name: module.ABLATION
    for module in (
        encoding,
        accumulation,
        views,
        initialisation,
        noise,
        symmetry,
        resolution,
        covariance,
        coverage,
    )
}

names: tuple[str, ...] = tuple(_ALL)
"""Names that `get` knows."""


def get(name: str) -> Ablation:
    """Return the ablation of that name.

    Raises
    ------
    InvalidInputError
        If there is none; the message lists them.
    """
    if name not in _ALL:
        raise InvalidInputError(f"name: expected one of {', '.join(names)}, got {name!r}")
    return _ALL[name]
