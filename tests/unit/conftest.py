"""One valid call that the input checks start from, and a recording for the command line."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.figure import Figure

import overlay_case
import skelsplat as sk
from calibration_files import openpose_folders
from command_line import READ, succeed
from skelsplat import synthetic
from skelsplat.io import sample, write_calibration
from skelsplat.run import Job
from skelsplat.viz import _style


@pytest.fixture
def scene() -> SimpleNamespace:
    """Three frames of a walk in the Human3.6M-like room: pose (T,N,3), detections (T,M,N,2), rig."""
    rig = synthetic.human36m_like()
    pose = synthetic.motion("walk", 3, seed=5)
    detections = sk.project(pose, rig).swapaxes(0, 1)
    return SimpleNamespace(rig=rig, pose=pose, detections=detections, layout="h36m17")


def write_recording(folder, n_frames=5):
    """Write a walk of some frames in four cameras, in mm; the last camera never sees joint 3."""
    rig = synthetic.human36m_like()
    pose = synthetic.motion("walk", n_frames, seed=3)
    detections = sk.project(pose, rig).swapaxes(0, 1)
    detections += np.random.default_rng(1).normal(0.0, 2.0, detections.shape)
    detections[:, -1, 3] = np.nan
    write_calibration(folder / "Calib.toml", rig)
    openpose_folders(folder / "openpose", rig, detections)
    return folder, rig, pose


# WebGL without a graphics card, as root.
_FLAGS = "--no-sandbox --disable-gpu --use-gl=angle --use-angle=swiftshader --enable-unsafe-swiftshader"


@pytest.fixture(scope="module")
def browser():
    """Open Chromium without a window."""
    chromium = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if chromium is None:
        pytest.skip("needs Chromium: apt-get install chromium")
    playwright = pytest.importorskip("playwright.sync_api")
    with playwright.sync_playwright() as running:
        opened = running.chromium.launch(executable_path=chromium, args=_FLAGS.split())
        yield opened
        opened.close()


@pytest.fixture(scope="session")
def walk():
    """Return the function that writes a recording into a folder."""
    return write_recording


@pytest.fixture
def recording(tmp_path, request):
    return write_recording(tmp_path, getattr(request, "param", 5))


@pytest.fixture
def folder(recording):
    return recording[0]


@pytest.fixture
def job(folder):
    """Return the job of the recording's files, with what a test changes."""

    def make(**options):
        given = {"unit": "mm", "layout": "h36m17", "fps": 50.0, **options}
        return Job(folder / "Calib.toml", folder / "openpose", **given)

    return make


@pytest.fixture(scope="session")
def finished_run(tmp_path_factory) -> Path:
    """Return the folder of a run over the recording; not to be written to, see `run_folder`."""
    folder, _, _ = write_recording(tmp_path_factory.mktemp("finished"))
    given = ["refine", folder / "Calib.toml", folder / "openpose", *READ, "--fps", 50, "--write", "csv"]
    succeed(*given, "-o", folder / "out")
    return folder / "out"


@pytest.fixture
def run_folder(finished_run, tmp_path) -> Path:
    """Return a copy of the run's folder, where `arguments` writes to."""
    return shutil.copytree(finished_run, tmp_path / "out")


@pytest.fixture
def case(tmp_path):
    """Return a run of two cameras to draw on images and videos."""
    return overlay_case.write_run(tmp_path / "run")


@pytest.fixture
def images(tmp_path):
    for name in ("cam01", "cam02"):
        overlay_case.write_images(tmp_path / "images" / name)
    return tmp_path / "images"


@pytest.fixture
def videos(tmp_path):
    for name in ("cam01", "cam02"):
        overlay_case.write_video(tmp_path / "videos" / f"{name}.mp4")
    return tmp_path / "videos"


@pytest.fixture
def short_sample(monkeypatch):
    """Leave the first twelve frames of the recording in the package."""
    extract = sample.extract

    def shortened(folder, **options):
        paths = extract(folder, **options)
        for camera in paths.detections.iterdir():
            for path in sorted(camera.iterdir())[12:]:
                path.unlink()
        return paths

    monkeypatch.setattr(sample, "extract", shortened)


@pytest.fixture
def arguments(folder):
    return ["refine", str(folder / "Calib.toml"), str(folder / "openpose"), "-o", str(folder / "out")]


@pytest.fixture
def figures(monkeypatch):
    """Keep the figures that are written, for looking at their axes."""
    kept: list[Figure] = []
    save = _style.save_png

    def keep(figure, path):
        kept.append(figure)
        return save(figure, path)

    monkeypatch.setattr(_style, "save_png", keep)
    return kept


@pytest.fixture
def gap(recording):
    """Take joint 16 out of all views of frame 2."""
    folder, rig, _ = recording
    for name in rig.names:
        path = folder / "openpose" / name / "000002_keypoints.json"
        document = json.loads(path.read_text())
        document["people"][0]["pose_keypoints_2d"][48:51] = [0.0, 0.0, 0.0]
        path.write_text(json.dumps(document))
    return folder
