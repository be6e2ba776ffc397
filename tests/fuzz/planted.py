"""Faults that the fuzzer must find, one per case."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from random import Random


def fine() -> str:
    return "fine"


def error() -> str:
    raise ValueError("planted")


def loop() -> str:
    while True:
        pass


def memory() -> str:
    return str(len(bytearray(2**40)))


def death() -> str:
    os.abort()


KINDS = {
    "nothing": fine,
    "an error": error,
    "a loop": loop,
    "memory": memory,
    "a death": death,
    "again": fine,
}


def case(_: Random, folder: Path) -> tuple[str, Callable[[], str]]:
    told, call = list(KINDS.items())[int(folder.name)]
    (folder / "input").write_text(told)
    return told, call
