"""Gaussian noise of any size."""

from __future__ import annotations

from measures.gaussian import noisy_scene, row
from methods import default

from attacks import attack


def _at(sigma_px: float) -> str:
    here = noisy_scene(sigma_px, 200, 0, 4)
    figures = row(here, default(here))
    return (
        f"{figures['default']:.1f} mm, DLT {figures['DLT conf.']:.1f}; {figures['beyond']:.1f} % beyond 3 σ"
    )


@attack("6a", "Gaussian noise of 2 px, 4 views", "as DLT, 3 % beyond")
def noise_of_2_px() -> str:
    return _at(2)


@attack("6b", "Gaussian noise of 10 px, 4 views", "as DLT, 3 % beyond")
def noise_of_10_px() -> str:
    return _at(10)


@attack("6c", "Gaussian noise of 20 px, 4 views", "as DLT, 3 % beyond")
def noise_of_20_px() -> str:
    return _at(20)


@attack("6d", "Gaussian noise of 40 px, 4 views", "as DLT, 3 % beyond")
def noise_of_40_px() -> str:
    return _at(40)
