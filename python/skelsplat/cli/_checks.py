"""Checks of options that several commands have."""

from __future__ import annotations

import typer

from skelsplat.io.poses import POSE_FORMATS


def one_of(option: str, value: str | None, choices: tuple[str, ...]) -> str:
    """Return ``value`` if it is one of ``choices``; None means that a required option is missing."""
    if value in choices:
        return value
    got = "nothing (the files do not say)" if value is None else repr(value)
    raise typer.BadParameter(f"expected one of {', '.join(choices)}, got {got}", param_hint=option)


def positive(option: str, value: float | None) -> float | None:
    """Return ``value`` if it is positive and finite, or None."""
    if value is None or 0 < value < float("inf"):
        return value
    raise typer.BadParameter(f"expected a positive number, got {value:g}", param_hint=option)


def some_of(option: str, value: str, choices: tuple[str, ...]) -> tuple[str, ...]:
    """Return the names in a list with commas, each once and each one of ``choices``."""
    names = tuple(dict.fromkeys(name.strip().lower().removeprefix(".") for name in value.split(",")))
    for name in names:
        if name not in choices:
            expected = f"some of {', '.join(choices)}"
            raise typer.BadParameter(f"expected {expected}, got {name!r}", param_hint=option)
    return names


def formats(value: str) -> tuple[str, ...]:
    """Return npz, which every run writes, and the pose formats in a list with commas, each once."""
    return tuple(dict.fromkeys(["npz", *some_of("--write", value, tuple(POSE_FORMATS))]))
