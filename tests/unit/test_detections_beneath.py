"""A folder too high: the message names the folder beneath it that has the detections."""

from __future__ import annotations

import json
from functools import partial

import numpy as np
import pytest

import skelsplat as sk
from broken_detections import NAMES, anybody, write_case
from skelsplat.io import read_detections
from skelsplat.io.detections import _registry
from skelsplat.io.detections._registry import folders_beneath

H36M = sk.layouts.H36M17

write = partial(write_case, people=anybody())


@pytest.mark.parametrize("name", ["openpose", "easymocap"])
def test_the_folder_above_is_told_which_one_beneath_it_has_detections(tmp_path, name):
    above = tmp_path / "recording"
    (above / "images").mkdir(parents=True)
    write(above / "walk", name)
    beneath = "annots" if name == "easymocap" else "walk"
    top = above / "walk" if name == "easymocap" else above
    with pytest.raises(sk.DatasetError, match=rf"folders with such detections .* \({beneath}/\)"):
        read_detections(top, NAMES, layout=H36M)


@pytest.mark.parametrize("beneath", ["pose", "subject1/pose", "session/subject1/trial"])
def test_detections_count_more_than_videos_beside_them(tmp_path, beneath):
    (tmp_path / "videos").mkdir()
    (tmp_path / "videos" / "camA.mp4").touch()
    write(tmp_path / beneath, "openpose")
    with pytest.raises(sk.DatasetError, match=rf"give one of them \({beneath}/\)$"):
        read_detections(tmp_path, NAMES, layout=H36M)


def test_folders_of_results_are_not_proposed_but_what_lies_in_them(tmp_path):
    report = {"versions": {"skelsplat": "0.1.0"}, "settings": {}}
    for folder in (tmp_path / "demo", tmp_path / "out"):
        folder.mkdir()
        (folder / "report.json").write_text(json.dumps(report))
        (folder / "pose.csv").write_text("frame,joint,x,y,z,unit\n")
        np.savez(folder / "detections.npz", detections=np.zeros((1, 2, 17, 3)))
    beneath = tmp_path / "demo" / "input" / "openpose"
    beneath.mkdir(parents=True)
    write(beneath, "openpose")
    with pytest.raises(sk.DatasetError, match=r"give one of them \(demo/input/openpose/\)$"):
        read_detections(tmp_path, NAMES, layout="h36m17")


def test_the_look_beneath_is_bounded(tmp_path, monkeypatch):
    for folder in ("a/b/c/d", "x", "y", ".hidden"):
        (tmp_path / folder).mkdir(parents=True)
    looked_at = []

    def wanted(folder):
        looked_at.append(folder.relative_to(tmp_path).as_posix())
        return folder.name == "d"

    assert folders_beneath(tmp_path, wanted) == []
    assert looked_at == ["a", "x", "y", "a/b", "a/b/c"]
    looked_at.clear()
    monkeypatch.setattr(_registry, "_FOLDERS", 4)
    folders_beneath(tmp_path, wanted)
    assert looked_at == ["a", "x", "y", "a/b"]
    looked_at.clear()
    monkeypatch.setattr(_registry, "_ENTRIES", 1)
    folders_beneath(tmp_path, wanted)
    assert sum("/" not in name for name in looked_at) <= 1
