"""A recording of a simulated mouse through files, with a layout of one's own, to every result."""

from __future__ import annotations

import re
import shutil

import numpy as np
import pytest

import mouse
import skelsplat as sk
from skelsplat import synthetic
from skelsplat.cli.output import Terminal
from skelsplat.cli.table import print_run
from skelsplat.io import read_layout, read_run, write_calibration
from skelsplat.run import Job, Run, run
from skelsplat.run.overlay import OverlayJob, write_overlay
from skelsplat.run.plots import read_source, write_plots
from skelsplat.viz.overlay import Shown

STEPS = 24


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Return the folder of a recording, the run with a layout file, and the true joints."""
    folder = tmp_path_factory.mktemp("mouse")
    truth = mouse.write(folder, STEPS)
    own = sk.Layout("my_mouse", mouse.LAYOUT.joints, limbs=mouse.LAYOUT.limbs)
    sk.layouts.write(folder / "my_mouse.toml", own)
    text = (folder / "my_mouse.toml").read_text(encoding="utf-8")
    kept = [line for line in text.splitlines() if not line.startswith(("left_right", "symmetric"))]
    (folder / "my_mouse.toml").write_text("\n".join(kept), encoding="utf-8")
    given = {"layout": str(folder / "my_mouse.toml"), "unit": "mm", "fps": mouse.FPS}
    found = run(Job(folder / "rig.toml", folder / "dlc", output=folder / "out", **given))
    shutil.move(folder / "my_mouse.toml", folder / "elsewhere.toml")  # the run's folder has all that it needs
    return folder, found, truth


def test_the_mouse_is_found(recorded):
    _, found, truth = recorded
    error = np.linalg.norm(found.poses.pose - truth, axis=-1)
    assert error.mean() < 0.6
    assert found.layout.left_right == mouse.LAYOUT.left_right
    assert [finding for finding in found.findings if finding.severity != "note"] == []


def test_the_folder_of_the_run_knows_the_layout(recorded):
    folder, found, _ = recorded
    assert "layout.toml" in found.report["files"]
    assert found.report["input"]["layout"] == "my_mouse"
    assert read_run(folder / "out").layout == found.layout
    assert Run.open(folder / "out").layout == found.layout
    page = (folder / "out" / "report.html").read_text(encoding="utf-8")
    assert "my_mouse, 22 joints" in page
    assert "scatter alone, without a bias of the detector" in page


def test_pictures_and_overlays_need_no_file_again(recorded):
    folder, _, _ = recorded
    source = read_source(folder / "out")
    assert len(source.limbs) == len(mouse.LAYOUT.limbs)
    (drawn,) = write_plots(source, folder / "plots", only=("bones",))
    assert drawn.files
    named = read_source(folder / "out" / "pose.trc", layout=folder / "elsewhere.toml")
    assert named.limbs == source.limbs
    job = OverlayJob(
        folder / "out", None, folder / "overlay", Shown(rejected_below=0.25), cameras=("camA",), png=True
    )
    (written,) = write_overlay(job)
    assert (list(written.cameras), written.frames) == (["camA"], STEPS)


def test_two_mice_are_told_apart_on_their_own_scale():
    rig, noise = mouse.rig(), synthetic.DetectionNoise(sigma_px=1.5)
    truth = [mouse.motion(STEPS) + np.array([0.0, y, 0.0]) for y in (0.0, 25.0)]
    seen = [
        synthetic.simulate_detections(one, rig, noise=noise, layout=mouse.LAYOUT, seed=k)
        for k, one in enumerate(truth)
    ]
    people = np.stack(seen, axis=2)
    people[::2, 1] = people[::2, 1, ::-1]  # the order in a view means nothing
    found = sk.track(people, rig, fps=mouse.FPS, layout="mouse22", config=sk.RefineConfig(sigma_mm=3.0))
    assert len(found) == 2
    errors = [[np.linalg.norm(one.refinement.pose - pose, axis=-1).mean() for pose in truth] for one in found]
    assert np.min(errors, axis=0).max() < 0.6


def test_the_skeleton_of_the_files_is_taken_as_it_is(recorded, tmp_path):
    folder, _, truth = recorded
    given = {"layout": "file", "unit": "mm", "html": False, "write": ()}
    found = run(Job(folder / "rig.toml", folder / "dlc", output=tmp_path / "out", **given))
    (note,) = (finding for finding in found.findings if finding.kind == "layout_of_file")
    assert "22 joints, 0 limbs, 8 left–right pairs by name (left_ear_tip–right_ear_tip" in note.text
    assert found.layout.name == "dlc"
    assert np.linalg.norm(found.poses.pose - truth, axis=-1).mean() < 1.2
    assert read_run(tmp_path / "out").layout == found.layout
    assert read_layout(tmp_path / "out" / "layout.toml") == found.layout


@pytest.fixture(scope="module")
def fly(tmp_path_factory):
    """Return the folder of the run of a simulated fly, 2.5 mm long, before cameras 200 mm apart."""
    folder = tmp_path_factory.mktemp("fly")
    layout, random = sk.layouts.get("fly38"), np.random.default_rng(0)
    lens = np.array([[8000.0, 0, 640], [0, 8000.0, 360], [0, 0, 1]])
    places = [100.0 * np.array([np.cos(a), np.sin(a), 0.5]) for a in np.arange(4) * np.pi / 2]
    poses = [synthetic.look_at(place, np.zeros(3)) for place in places]
    cameras = [sk.Camera(lens, R, t, size=(1280, 720), name=f"c{k}") for k, (R, t) in enumerate(poses)]
    rig = sk.CameraRig(cameras, unit="mm")
    truth = random.normal(0.0, 0.6, (38, 3)) + np.cumsum(random.normal(0.0, 0.06, (STEPS, 1, 3)), axis=0)
    pixels = sk.project(truth, rig).swapaxes(0, 1)
    pixels += random.normal(0.0, 0.5, pixels.shape)
    names = {"camera_names": rig.names, "joint_names": layout.joints, "frame_rate": 100.0}
    np.savez(folder / "detections.npz", detections=pixels, **names)
    write_calibration(folder / "rig.json", rig)
    return folder / "out", run(Job(folder / "rig.json", folder / "detections.npz", output=folder / "out"))


def test_lengths_of_a_fly_have_two_digits(fly, capsys):
    folder, found = fly
    assert found.statistics.decimals == 4
    print_run(Terminal(), found)
    printed = capsys.readouterr().out
    page = (folder / "report.html").read_text(encoding="utf-8")
    middle = f"{np.nanmedian(found.statistics.error_bar_mm):.4f} mm"
    assert middle.startswith("0.004")
    assert f"median {middle}." in printed
    assert middle in page
    for text in (printed, page):
        assert not re.search(r"\b0\.0 mm|\b0 mm|\b0\.0 \(0\.0\)", text)
    assert re.search(r"0\.00\d\d \(0\.00\d\d\)", printed)
    assert re.search(r"0\.00\d\d \(0\.00\d\d\)", page)  # a row of the table of joints
