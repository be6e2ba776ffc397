"""Attacks on the library: calls that could give a wrong result silently, hang or end the process.

Every module here holds functions marked with ``@attack(order, what, ideal)``. A function takes nothing and
returns a short text of numbers. Modules use the public interface only, so that they also run against earlier
versions.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable
from dataclasses import dataclass

LIMIT_S = 120.0


@dataclass(frozen=True)
class Attack:
    """One row of the table: what is done, the correct result, and the function that does it."""

    order: str
    what: str
    ideal: str
    run: Callable[[], str]
    limit_s: float

    @property
    def name(self) -> str:
        """The name that selects the row on the command line."""
        return self.run.__name__


_REGISTERED: list[Attack] = []


def attack(
    order: str, what: str, ideal: str, *, limit_s: float = LIMIT_S
) -> Callable[[Callable[[], str]], Callable[[], str]]:
    """Register a function as a row; rows are sorted by ``order`` ("1a", "1b", "2a", …)."""

    def register(run: Callable[[], str]) -> Callable[[], str]:
        _REGISTERED.append(Attack(order, what, ideal, run, limit_s))
        return run

    return register


def attacks() -> list[Attack]:
    """Every attack of every module, sorted by its order."""
    for module in pkgutil.iter_modules(__path__):
        importlib.import_module(f"{__name__}.{module.name}")
    return sorted(_REGISTERED, key=lambda a: (int(a.order.rstrip("abcdefghijklmnopqrstuvwxyz")), a.order))
