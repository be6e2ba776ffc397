"""What an installed package has to carry."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from importlib import metadata, resources
from pathlib import Path

import pytest

import skelsplat

ROOT = Path(__file__).parents[2]


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


def notices() -> set[tuple[str, str]]:
    text = (ROOT / "licenses/third-party.yml").read_text(encoding="utf-8")
    return set(re.findall(r"^- package_name: (\S+)\n  package_version: (\S+)$", text, re.MULTILINE))


def components() -> set[tuple[str, str]]:
    document = json.loads((ROOT / "licenses/skelsplat.cdx.json").read_text(encoding="utf-8"))
    return {(one["name"], one["version"]) for one in document["components"]}


@pytest.mark.skipif(shutil.which("cargo") is None, reason="cargo tells what the compiled module consists of")
@pytest.mark.parametrize("listed", [notices, components])
def test_notices_and_the_bill_of_materials_list_what_is_compiled(listed) -> None:
    """If they do not, run `make notices`."""
    locked = (ROOT / "Cargo.lock").read_text(encoding="utf-8")
    known = set(re.findall(r'^name = "(.+)"\nversion = "(.+)"$', locked, re.MULTILINE))
    tree = ["cargo", "tree", "--locked", "--package", "skelsplat-py", "--edges", "normal", "--prefix", "none"]
    shown = subprocess.run(tree, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    compiled = set(re.findall(r"^(\S+) v(\S+)", shown, re.MULTILINE))
    ours = {"skelsplat-core", "skelsplat-py"}
    assert {(name, version) for name, version in compiled if name not in ours} <= listed() <= known


def test_every_licence_text_is_there() -> None:
    assert "NOT FOUND" not in (ROOT / "licenses/third-party.yml").read_text(encoding="utf-8")
