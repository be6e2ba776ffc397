"""`skelsplat datasets`: what it prints, and its exit status."""

from __future__ import annotations

import json

import pytest

from command_line import invoke, succeed
from skelsplat import datasets
from writers import human36m as write


def plain(result):
    """All that is printed, without line breaks."""
    return " ".join(result.stdout.split())


@pytest.fixture
def good(tmp_path):
    write.write_skelsplat(tmp_path, write.record())
    return tmp_path


def test_list_names_all_data_sets():
    result = succeed("datasets", "list")
    for name in datasets.names():
        assert name in result.stdout
    entries = json.loads(invoke("datasets", "list", "--json").stdout)
    assert [entry["name"] for entry in entries] == list(datasets.names())
    assert "detections" in entries[0]["options"]


def test_a_good_data_set_is_status_0(good):
    result = succeed("datasets", "check", "human36m", good)
    text = plain(result)
    assert "S11 4 24 4 17 100.0 % 100.0 %" in text
    assert text.count("60457274") == 1
    result = succeed("datasets", "check", "human36m", good, "--json")
    report = json.loads(result.stdout)
    assert (report["ok"], report["format"]) == (True, "skelsplat")
    assert len(report["files"]["there"]) == 1 + 8 + 8 * 4, "cameras, truth, and detections of every view"
    assert report["files"]["missing"] == report["findings"] == []
    first = report["dataset"]["takes"][0]
    assert (first["key"], first["frames"], first["views"]) == ("S9/Directions", 6, list(write.CAMERAS))
    assert report["dataset"]["joints"] == 17
    assert list(report["reprojection_px"]) == list(write.CAMERAS)
    assert all(px < 3 for px in report["reprojection_px"].values())


def test_all_that_is_missing_is_status_1_and_listed(good):
    folder = good / "2d_metrabs" / "S9" / "Directions"
    missing = [folder / camera / "poses.npz" for camera in ("58860488", "60457274")]
    for path in missing:
        path.unlink()
    result = invoke("datasets", "check", "human36m", good)
    assert result.exit_code == 1
    assert all(str(path) in plain(result) for path in missing)
    report = json.loads(invoke("datasets", "check", "human36m", good, "--json").stdout)
    assert [entry["path"] for entry in report["files"]["missing"]] == list(map(str, missing))
    assert report["dataset"] is None
    assert not report["ok"]


def test_options_reach_the_reader(tmp_path):
    recording = write.record()
    write.write_videopose3d(tmp_path, recording)
    write.write_detections(tmp_path / "2d_CPN", recording)
    chosen = ("--detections", tmp_path / "2d_CPN", "--set", "subjects=S9,")
    result = invoke("datasets", "check", "human36m", tmp_path, *chosen, "--json")
    report = json.loads(result.stdout)
    assert report["dataset"]["detector"] == "cpn"
    assert {take["subject"] for take in report["dataset"]["takes"]} == {"S9"}
    (tmp_path / "data_2d_h36m_cpn_ft_h36m_dbb.npz").unlink()
    assert "No detections" in invoke("datasets", "check", "human36m", tmp_path).stdout


@pytest.mark.parametrize(
    ("args", "word"),
    [
        (("human37m", "ROOT"), "NAME"),
        (("human36m", "ROOT", "--set", "x=1"), "--set"),
        (("human36m", "ROOT", "--format", "coco"), "format"),
    ],
)
def test_bad_usage_is_status_2(good, args, word):
    result = invoke("datasets", "check", *(good if arg == "ROOT" else arg for arg in args))
    assert (result.exit_code, result.stdout) == (2, "")
    assert word in result.stderr
