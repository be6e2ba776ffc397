"""The recording that ships with the package, read through the readers a user would use."""

from __future__ import annotations

import numpy as np

from command_line import invoke, read_report
from skelsplat.io import read_calibration, read_detections, sample


def test_two_people_and_a_bystander(tmp_path):
    paths = sample.extract(tmp_path, people=True)
    rig = read_calibration(paths.calibration, unit=sample.UNIT)
    found = read_detections(paths.detections, rig, layout=sample.LAYOUT)
    assert found.people.shape[0::3] == (100, 25)
    np.testing.assert_array_equal(np.median(found.people_per_frame, axis=0), [3, 3, 2, 2])
    assert {path.name for path in tmp_path.iterdir()} >= {"LICENSE.pose2sim", "NOTICE.pose2sim"}


def test_the_demo_of_several_people(tmp_path, monkeypatch):
    """It has a folder of its own: that of the other demo keeps its files and its input."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "skelsplat-demo").mkdir()
    result = invoke("demo", "--people")
    assert not list((tmp_path / "skelsplat-demo").iterdir())
    tmp_path = tmp_path / "skelsplat-demo-people"
    assert result.exit_code == 0, result.output
    long = [line for line in result.stdout.splitlines() if len(line) > 80]
    assert all(line.startswith("skelsplat check-cameras ") for line in long)  # a command is one line, to copy
    assert "was added to this recording by calculation" in " ".join(result.stdout.split())
    people = read_report(tmp_path)["people"]
    assert [(one["first_frame"], one["last_frame"], one["views_median"]) for one in people] == [
        *[(0, 99, 4)] * 2,
        (0, 99, 2),
    ]
