"""Nothing outside the folder that the page was opened with is read or written."""

from __future__ import annotations

import pytest

from skelsplat.app.places import Place
from skelsplat.exceptions import InvalidInputError


@pytest.fixture
def place(tmp_path):
    for name in ("root/walk", "root/.hidden", "outside"):
        (tmp_path / name).mkdir(parents=True)
    (tmp_path / "root/way-out").symlink_to(tmp_path / "outside", target_is_directory=True)
    return Place((tmp_path / "root").resolve())


def test_folders_are_those_in_it_that_are_shown(place):
    assert [one.name for one in place.folders(place.root)] == ["walk"]
    assert place.relative(place.folder("walk")) == "walk"
    assert place.relative(place.root) == ""
    with pytest.raises(InvalidInputError, match="that exists"):
        place.folder("nowhere")


def test_a_file_may_bring_its_folders(place):
    assert (
        place.file_to_write(place.root / "walk", "pose\\cam01/a.json")
        == place.root / "walk/pose/cam01/a.json"
    )
