"""Every reader with something wrong: it is refused, and the error names the file and the field."""

from __future__ import annotations

import json
import pickle
import shutil
from functools import cache

import numpy as np
import pytest

from skelsplat import DatasetError, datasets
from writers import human36m, occlusion_person, panoptic, shelf_campus

SEQUENCE = panoptic.SEQUENCES[0]
SHORT_VIEWS = f"2d_metrabs/S0/{SEQUENCE}/poses_filtered_4.npz"
PERSON_TRUTH = f"3d_gt/S0/{occlusion_person.ACTIVITY}/poses.npz"
EVERYBODY = "2d_hrnet/S0/people.npz"
POSES = "3d_gt/S9/Directions/poses.npz"
TRUTH = "data_3d_h36m.npz"
CPN = "data_2d_h36m_cpn_ft_h36m_dbb.npz"
PARAMETERS = "camera-parameters.json"
CALIBRATION = f"calibration_{SEQUENCE}.json"
BODY = f"body3DScene_{panoptic.FIRST_FRAME + 1:08d}.json"


# Each of these gives a function that spoils what is written beneath a folder.


def arrays(name, change):
    """Change the arrays of an npz file; one that becomes None is left out."""

    def apply(root):
        with np.load(root / name, allow_pickle=True) as archive:
            found = dict(archive)
        found |= change(found)
        np.savez(root / name, **{key: value for key, value in found.items() if value is not None})

    return apply


def content(name, change):
    """Change what a JSON file holds in place."""

    def apply(root):
        path = next(root.rglob(name))
        found = json.loads(path.read_text())
        change(found)
        path.write_text(json.dumps(found))

    return apply


def predictions(value):
    return lambda root: next(root.rglob("pred_*.pkl")).write_bytes(pickle.dumps(value))


def cut(name, share=0.5):
    def apply(root):
        path = next(root.rglob(name))
        whole = path.read_bytes()
        path.write_bytes(whole[: int(share * len(whole))])

    return apply


def removed(name):
    def apply(root):
        next(root.rglob(name)).unlink()

    return apply


def h36m(layout, spoil=lambda _: None):
    """Write Human3.6M in a layout, spoiled before it is written."""

    def write(root):
        recording = human36m.record()
        spoil(recording)
        getattr(human36m, f"write_{layout}")(root, recording)

    return write


def kept(_):
    """Leave the files as they are."""


def unlike(keys):
    return lambda root: panoptic.write(root, **keys)


AUTHORS, POSE3D, HOURGLASS = (h36m(name) for name in ("skelsplat", "videopose3d", "hourglass"))
WALK = "S9_Directions_1.npz"
NO_TEXT = np.frombuffer(b"S\0\0\0\0\0\x20\0", "<U2")  # a character beyond Unicode
PERSONS = occlusion_person.write
SHELF = lambda root: shelf_campus.write(root, "shelf")  # noqa: E731
PEOPLE = lambda root: shelf_campus.write_everybody(root, "shelf", n_frames=4)  # noqa: E731
PICKLED = lambda root: shelf_campus.write_everybody(root, "shelf", form="pickle", n_frames=2)  # noqa: E731


# Data set → what is written, what is changed then, the file and the field that the error names, options.
CASES = {
    "human36m": [
        (h36m("skelsplat", lambda r: r.scale_truth(0.001)), kept, "poses.npz", "truth"),
        (h36m("skelsplat", lambda r: r.exchange_sides()), kept, "Directions", "left and right"),
        (h36m("skelsplat", lambda r: r.drop_joint()), kept, POSES, "poses"),
        (h36m("videopose3d", lambda r: r.drop_joint()), kept, TRUTH, "positions_3d.S9.Directions"),
        (AUTHORS, content(PARAMETERS, lambda d: d["extrinsics"]["S11"].pop("58860488")),
         PARAMETERS, "cameras"),
        (AUTHORS, removed("Greeting 1/55011271/poses.npz"), "55011271/poses.npz", "file"),
        (POSE3D, arrays(CPN, lambda a: a["positions_2d"].item()["S11"]["Photo 1"].pop() is None or {}),
         CPN, "positions_2d.S11.Photo 1"),
        (AUTHORS, arrays(POSES, lambda a: {"poses": a["poses"][1:]}), "poses.npz", "poses2d"),
        (AUTHORS, cut(POSES), "poses.npz", "file"),
        (POSE3D, cut(TRUTH, 0.9), TRUTH, "file"),
    ],
    "human36m-hourglass": [
        (HOURGLASS, kept, "", "subjects", {"subjects": ["S5"]}),
        (HOURGLASS, arrays(WALK, lambda a: {"K": a["K"][:3]}), WALK, "K"),
        (HOURGLASS, arrays(WALK, lambda a: {"gt3d": a["gt3d"][1:]}), WALK, "gt3d"),
        (HOURGLASS, arrays(WALK, lambda a: {"det2d": a["det2d"][:0]}), WALK, "det2d"),
        (HOURGLASS, arrays(WALK, lambda a: {"pairs": a["pairs"] + 5}), WALK, "pairs"),
        (HOURGLASS, arrays(WALK, lambda a: {"det_joints": [*a["det_joints"][:15], "tail"]}),
         WALK, "det_joints[15]"),
        (HOURGLASS, arrays(WALK, lambda _: {"sequence": None}), WALK, "sequence"),
        (HOURGLASS, arrays(WALK, lambda _: {"sequence": NO_TEXT.reshape(())}), WALK, "sequence"),
    ],
    "panoptic": [
        (panoptic.write, content(BODY, lambda d: d["bodies"].append({**d["bodies"][0], "id": 7})),
         "hdPose3d_stage1_coco19", "bodies"),
        (panoptic.write, content(BODY, lambda d: d["bodies"][0].update(joints19=[1.0])),
         BODY, "bodies[0].joints19"),
        (panoptic.write, content(CALIBRATION, lambda d: d["cameras"].pop(5)),
         CALIBRATION, "cameras"),
        (panoptic.write, arrays(SHORT_VIEWS, lambda a: {"poses2d": a["poses2d"][:, :, :17]}),
         SHORT_VIEWS, "poses2d"),
        (panoptic.write, arrays(SHORT_VIEWS, lambda a: {"frames": a["frames"] + 5000}),
         SHORT_VIEWS, "frames"),
        (panoptic.write, cut(BODY, 0.3), BODY, "JSON"),
        (panoptic.write, kept, "initial_guess/other", "file", {"monocular": "other"}),
        (panoptic.write, removed(CALIBRATION), CALIBRATION, "file"),
        (unlike({"per_camera": True}), removed("10/poses_filtered_4.npz"),
         "10/poses_filtered_4.npz", "file"),
        (unlike({"layout": "skelsplat"}), kept, "poses_filtered_4.npz", "truth", {"truth_unit": "m"}),
    ],
    "occlusion-person": [
        (PERSONS, content("cameras.json", lambda d: d["5"].pop()), "cameras.json", "5"),
        (PERSONS, arrays(PERSON_TRUTH, lambda a: {"poses3d": a["poses3d"][2:]}), "poses.npz", "poses3d"),
    ],
    "shelf": [
        (SHELF, content("calibration_shelf.json", lambda d: d.pop("3")),
         "calibration_shelf.json", "3"),
        (SHELF, lambda root: shelf_campus.write_actors(root / "actorsGT.mat", [np.ones((3, 13, 3))]),
         "actorsGT.mat", "actor3D{1}{1}"),
        (SHELF, cut("actorsGT.mat"), "actorsGT.mat", "file"),
        (PEOPLE, arrays(EVERYBODY, lambda a: {"people": a["people"][:, :3]}), EVERYBODY, "people"),
        (PEOPLE, arrays(EVERYBODY, lambda a: {"people": a["people"][..., :9, :]}), EVERYBODY, "people"),
        (PICKLED, predictions({"0-300": []}), "pred_shelf", "'0-300'"),
        (PICKLED, predictions({"7_300": []}), "pred_shelf", None),
        (PICKLED, predictions({"0_300": [{"box": 1}]}), "pred_shelf", "0_300[0].pred"),
    ],
}  # fmt: skip


@pytest.fixture(scope="module")
def as_written(tmp_path_factory):
    """Return the folder that a function wrote to, once; not to be written to."""

    @cache
    def write(function):
        folder = tmp_path_factory.mktemp("whole")
        function(folder)
        return folder

    return write


@pytest.mark.parametrize(("name", "k"), [(name, k) for name in CASES for k in range(len(CASES[name]))])
def test_it_is_refused(tmp_path, as_written, name, k):
    write, change, file, field, options = (*CASES[name][k], {})[:5]
    shutil.copytree(as_written(write), tmp_path, dirs_exist_ok=True)
    change(tmp_path)
    with pytest.raises(DatasetError) as caught:
        datasets.read(name, tmp_path, **options)
    assert file in str(caught.value.path)
    assert field in (None, caught.value.field)
    report = datasets.check(name, tmp_path, **options)
    assert not report.ok
    if "removed" in change.__qualname__:
        assert caught.value.path in [path for path, _ in report.survey.missing]


def test_no_root_no_format_two_formats_and_no_subject(tmp_path):
    def field(root, **options):
        with pytest.raises(DatasetError) as caught:
            datasets.read("human36m", root, **options)
        return caught.value.field

    assert field(tmp_path / "nowhere") == "root"
    assert field(tmp_path) == "format"
    AUTHORS(tmp_path)
    assert field(tmp_path, subjects=("S1",)) == "subjects"
    (tmp_path / TRUTH).touch()
    assert field(tmp_path) == "format"
    assert "skelsplat" in datasets.read("human36m", tmp_path, format="skelsplat", subjects=["S11"]).source
