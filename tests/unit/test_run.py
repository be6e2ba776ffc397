"""A run as a library: from files, from arrays and from its folder, without a word on stdout or stderr."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import skelsplat as sk
from skelsplat import synthetic, viz
from skelsplat.layouts import mirror_images
from skelsplat.run import Run, run

LAYOUT = "h36m17"


def scene():
    """Return detections of a walk in which one camera's are shifted, and the rig."""
    rig = synthetic.human36m_like()
    pixels = sk.project(synthetic.motion("walk", 6, seed=3), rig).swapaxes(0, 1)
    pixels = pixels + np.random.default_rng(1).normal(0.0, 2.0, pixels.shape)
    pixels[:, 1] += 40.0
    return pixels, rig


def test_a_run_of_files_returns_and_never_prints(job, recording, capfd):
    _, rig, pose = recording
    seen = []
    found = run(job(), progress=lambda done, total: seen.append((done, total)))
    assert capfd.readouterr() == ("", "")
    assert (seen[0], seen[-1]) == ((0, 5), (5, 5))
    assert np.linalg.norm(found.poses.pose - pose, axis=-1).mean() < 16.3  # as the command line's
    assert found.cameras.names == rig.names
    assert (found.layout.name, found.frames.tolist()) == (LAYOUT, [0, 1, 2, 3, 4])
    assert found.detections.shape == (5, 4, 17, 3)
    assert repr(found) == "Run(5 frames of 17 joints, 4 cameras, no findings)"
    assert found.report["files"] == []


def test_warnings_are_findings_and_told_before_the_work(job, tmp_path):
    told = []
    found = run(job(fps=None, output=tmp_path / "out", html=False), tell=told.append)
    assert [finding.kind for finding in told] == ["times_assumed"]
    assert told[0] in found.findings


def test_an_opened_run_is_the_run_that_was_written(job, tmp_path):
    found = run(job())
    names = found.write(tmp_path / "out", html=False)
    assert {path.name for path in (tmp_path / "out").iterdir()} == set(names)
    again = Run.open(tmp_path / "out")
    assert again.findings == found.findings
    assert again.frame_findings == found.frame_findings
    files = [name for name in names if name != "report.json"]
    assert again.report == {**found.report, "files": files, "run": again.report["run"]}
    for name in ("pose", "uncertainty", "view_weights", "joint_status"):
        np.testing.assert_array_equal(getattr(again.result, name), getattr(found.result, name))
    assert again.statistics.total == found.statistics.total
    again.write_html(tmp_path / "again.html")
    assert "SkelSplat: openpose" in (tmp_path / "again.html").read_text(encoding="utf-8")


@pytest.mark.drawn
def test_a_result_made_of_arrays_has_findings_report_and_figures(tmp_path, capfd):
    pixels, rig = scene()
    result = sk.refine(None, pixels, rig, layout=LAYOUT)
    found = Run.from_arrays(result, rig, pixels, LAYOUT, frames=np.arange(10, 16), fps=25.0)
    assert [finding.kind for finding in found.findings] == ["camera_disagrees"]
    (finding,) = found.findings
    assert finding.subject.cameras == (rig.names[1],)
    assert found.report["input"]["detections"] is None
    assert found.report["input"]["first_frame"] == 10
    found.write_html(tmp_path / "report.html")
    assert finding.text[:40] in (tmp_path / "report.html").read_text(encoding="utf-8")
    assert found.write_figures(tmp_path / "figures") == ["overview.png", "weights.png"]
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("share", "numbers"), [(0.3, {"share_of_frames": 0.3}), (1.0, {"swapped_share": pytest.approx(12 / 17)})]
)
def test_a_view_whose_sides_are_swapped_is_named_once(share, numbers):
    rig, layout = synthetic.human36m_like(), sk.layouts.get(LAYOUT)
    found = synthetic.simulate_detections(
        synthetic.motion("walk", 20, seed=3), rig, noise=synthetic.DetectionNoise.good(), seed=1
    )
    places = np.arange(20) < share * 20
    found[places, 1] = found[places, 1][:, mirror_images(layout.n_joints, layout.left_right)]
    result = sk.refine(None, found, rig, layout=layout)
    findings = Run.from_arrays(result, rig, found, layout, fps=50.0).findings
    (finding,) = [one for one in findings if one.kind == "sides_swapped"]
    assert finding.subject.cameras == (rig.names[1],)
    assert finding.numbers == numbers


def test_show_opens_the_page_which_says_why_the_error_of_two_views_rises(monkeypatch):
    pixels, rig = scene()
    pixels, rig = pixels[:, ::2], sk.CameraRig(list(rig)[::2])
    found = Run.from_arrays(sk.refine(None, pixels, rig, layout=LAYOUT), rig, pixels, LAYOUT)
    opened = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    found.show()
    page = Path(opened[0].removeprefix("file://"))
    assert page.name == "report.html"
    assert "it rises because" in page.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("options", "field"),
    [
        ({"unit": "inch"}, "unit"),
        ({"frames": "some"}, "frames"),
        ({"init_sigma_mm": 40.0, "init": "a.npz", "config": sk.RefineConfig.paper()}, "init_sigma_mm"),
        ({"fill_weak": True}, "fill_weak: requires fill_gaps"),
        ({"filter": "butterworth", "fps": None}, "filter: requires fps"),
        ({"filter": "kalman"}, "filter"),
        ({"write": ("fbx",)}, "write"),
    ],
)
def test_an_option_that_is_wrong_is_named(job, options, field):
    with pytest.raises(sk.InvalidInputError, match=f"^{field}"):
        job(**options)


@pytest.mark.drawn
def test_detections_and_reprojections_are_in_the_same_pixels(tmp_path, monkeypatch):
    """Both are ideal ones: where detections are exact, they meet."""
    rig = synthetic.human36m_like(distortion=True)
    seen = sk.project(synthetic.motion("walk", 1, seed=3), rig).swapaxes(0, 1)
    config = sk.RefineConfig.paper(max_steps=20)
    result = sk.refine(None, seen, rig, layout="h36m17", config=config)
    given = {}
    for name in ("write_overview", "write_weights"):
        monkeypatch.setattr(viz, name, lambda _, data, name=name, **__: given.update({name: data}))
    Run.from_arrays(result, rig, seen, "h36m17", config=config).write_figures(tmp_path)
    assert max(np.abs(seen[0, i] - rig[i].undistort(seen[0, i])).max() for i in range(4)) > 5.0
    for picture in given["write_overview"].panels:
        assert np.abs(picture.detections - picture.reprojection).max() < 1.0
