"""What an installed package has to carry."""

from __future__ import annotations

from importlib import metadata, resources

import pytest

import skelsplat


@pytest.mark.parametrize(
    "name",
    [
        "py.typed",
        "_skelsplat.pyi",
        "data/pose2sim_demo.zip",
        "data/pose2sim_people.zip",
        "data/LICENSE.pose2sim",
    ],
)
def test_files_beside_the_code(name: str) -> None:
    assert resources.files("skelsplat").joinpath(name).is_file()


def test_one_version() -> None:
    assert skelsplat.__version__ == metadata.version("skelsplat")


def test_public_names_exist() -> None:
    assert all(hasattr(skelsplat, name) for name in skelsplat.__all__)
