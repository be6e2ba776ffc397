"""Every reader with something wrong: it is refused, and the error names the file and the field."""

from __future__ import annotations

import json
import pickle
from fractions import Fraction

import numpy as np
import pytest
from scipy.io import savemat

import skelsplat as sk
from skelsplat import DatasetError, InvalidInputError, datasets
from writers import human36m, occlusion_person, panoptic, shelf_campus

SEQUENCE = panoptic.SEQUENCES[0]
DETECTED = f"2d_metrabs/S0/{SEQUENCE}/poses_filtered_4.npz"
PERSON = "2d_resnet50/S0/validation/poses.npz"
ACTOR = "2d_hrnet/S0/actor1/poses.npz"
EVERYBODY = "2d_hrnet/S0/people.npz"
CPN = "data_2d_h36m_cpn_ft_h36m_dbb.npz"


def arrays(name, change):
    """Change the arrays of an npz file; a key that is None is left out."""

    def apply(root):
        with np.load(root / name, allow_pickle=True) as archive:
            found = dict(archive)
        found = found | change(found)
        np.savez(root / name, **{key: value for key, value in found.items() if value is not None})

    return apply


def document(name, change):
    """Change the content of a JSON file in place."""

    def apply(root):
        path = next(root.rglob(name))
        content = json.loads(path.read_text())
        change(content)
        path.write_text(json.dumps(content))

    return apply


def records(name, change):
    """Change what a pickle holds, in place or by a new value."""

    def apply(root):
        path = next(root.rglob(name))
        content = pickle.loads(path.read_bytes())
        path.write_bytes(pickle.dumps(change(content) or content, protocol=2))

    return apply


def each(change):
    """Change every record of a pickle."""
    return lambda found: [change(record) for record in found] and None


def labels(change):
    def apply(root):
        path = next(root.glob("human36m-*.npy"))
        content = np.load(path, allow_pickle=True).item()
        change(content)
        np.save(path, content, allow_pickle=True)

    return apply


def removed(name):
    return lambda root: (root / name).unlink()


def cut(name, share=0.5):
    def apply(root):
        path = next(root.rglob(name))
        content = path.read_bytes()
        path.write_bytes(content[: int(share * len(content))])

    return apply


def order_of(layout):
    order = np.arange(layout.n_joints)
    for left, right in layout.left_right:
        order[[left, right]] = right, left
    return order


def h36m(layout, spoil=lambda _: None):
    """Write Human3.6M in a layout, spoiled before it is written."""

    def write(root):
        recording = human36m.record()
        spoil(recording)
        if layout == "karfly":
            human36m.write_detections(root / "2d_cpn", recording, numbered=True)
        getattr(human36m, f"write_{layout}")(root, recording)

    return write


def shorter(recording):
    for take in recording.takes:
        take.pixels = take.pixels[:, :, :16]


def far(record):
    record["image_id"] += 1000 * (record["camera_id"] == 3)


def metres(record):
    record["joints_gt"] = record["joints_gt"] / 1000.0


def translation(record):
    record["camera"]["T"] = -record["camera"]["R"] @ record["camera"]["T"]


def in_metres(cameras, factor):
    for camera in cameras:
        camera["t"] = (np.array(camera["t"]) / factor).tolist()


def shelf(root):
    shelf_campus.write(root, "shelf")


def everybody(root):
    shelf_campus.write_everybody(root, "shelf", n_frames=4)


def pickled(root):
    shelf_campus.write_everybody(root, "shelf", form="pickle", n_frames=2)


def authors(root):
    occlusion_person.write(root, layout="skelsplat")


KEEP = None
POSES = "3d_gt/S9/Directions/poses.npz"
ADAFUSE = "h36m_validation.pkl"
UNREAL = "unrealcv_validation.pkl"
LABELS = "human36m-multiview-labels-GTbboxes.npy"
CALIBRATION = f"calibration_{SEQUENCE}.json"
BODY = f"body3DScene_{panoptic.FIRST_FRAME + 1:08d}.json"
ALL_VIEWS = {"detections": "2d_cpn"}

# What is written, what is changed then, the file and the field that the error names, and options.
H36M = [
    (h36m("skelsplat", lambda r: r.scale_truth(0.001)), KEEP, "poses.npz", "truth"),
    (h36m("karfly", lambda r: r.scale_truth(0.001)), KEEP, LABELS, "truth", ALL_VIEWS),
    (h36m("videopose3d", lambda r: r.scale_truth(1000.0)), KEEP, "data_3d_h36m.npz", "truth"),
    (
        h36m("adafuse"),
        records(ADAFUSE, each(lambda r: r.update(joints_3d=r["joints_3d"] / 1000))),
        ADAFUSE,
        "truth",
    ),
    *(
        (
            h36m(layout),
            document(
                "camera-parameters.json",
                lambda d: [in_metres(one.values(), 1000) for one in d["extrinsics"].values()],
            ),
            "camera-parameters.json",
            "cameras",
        )
        for layout in ("skelsplat", "videopose3d")
    ),
    (h36m("skelsplat", lambda r: r.exchange_sides()), KEEP, "Directions", "left and right"),
    (h36m("skelsplat", lambda r: r.drop_joint()), KEEP, POSES, "poses"),
    (h36m("karfly", lambda r: r.drop_joint()), KEEP, LABELS, "table.keypoints", ALL_VIEWS),
    (h36m("adafuse", lambda r: r.drop_joint()), KEEP, ADAFUSE, "[0].joints_3d"),
    (
        h36m("videopose3d", lambda r: r.drop_joint()),
        KEEP,
        "data_3d_h36m.npz",
        "positions_3d.S9.Directions",
    ),
    (h36m("skelsplat", shorter), KEEP, "54138969/poses.npz", "poses2d"),
    (h36m("videopose3d", shorter), KEEP, CPN, "positions_2d.S9.Directions, camera 54138969"),
    (
        h36m("skelsplat"),
        document("camera-parameters.json", lambda d: d["extrinsics"]["S11"].pop("58860488")),
        "camera-parameters.json",
        "cameras",
    ),
    (h36m("skelsplat"), removed("2d_metrabs/S9/Greeting 1/55011271/poses.npz"), "55011271/poses.npz", "file"),
    (
        h36m("karfly"),
        labels(lambda d: d.update(camera_names=["1", *d["camera_names"][1:]])),
        LABELS,
        "camera_names",
        ALL_VIEWS,
    ),
    (
        h36m("karfly"),
        labels(lambda d: d.update(cameras=d["cameras"][:, :3])),
        LABELS,
        "cameras[S9, 60457274]",
        ALL_VIEWS,
    ),
    (
        h36m("adafuse"),
        records(ADAFUSE, lambda rs: [r for r in rs if r["camera_id"] != 2 or r["action"] != 5]),
        ADAFUSE,
        "S9/Greeting-2, camera_id",
    ),
    (h36m("adafuse"), records(ADAFUSE, each(far)), ADAFUSE, "S9/Directions-1, image_id"),
    (
        h36m("adafuse"),
        records(ADAFUSE, lambda rs: rs[1].update(joints_3d=rs[1]["joints_3d"] + 50)),
        ADAFUSE,
        "S9/Directions-1, joints_3d",
    ),
    (
        h36m("videopose3d"),
        arrays(CPN, lambda found: found["positions_2d"].item()["S11"]["Photo 1"].pop() is None or {}),
        CPN,
        "positions_2d.S11.Photo 1",
    ),
    (h36m("skelsplat"), arrays(POSES, lambda found: {"poses": found["poses"][1:]}), "poses.npz", "poses2d"),
    (h36m("skelsplat"), cut("poses.npz"), "poses.npz", "file"),
    (h36m("karfly"), cut(LABELS, 0.3), LABELS, None, ALL_VIEWS),
    (h36m("adafuse"), cut(ADAFUSE, 0.999), ADAFUSE, None),
    (h36m("videopose3d"), cut("data_3d_h36m.npz", 0.9), "data_3d_h36m.npz", "file"),
]
PANOPTIC = [
    (
        panoptic.write,
        document(BODY, lambda d: d["bodies"].append(dict(d["bodies"][0], id=7))),
        BODY,
        "bodies",
    ),
    (
        panoptic.write,
        document(BODY, lambda d: d["bodies"][0].update(joints19=d["bodies"][0]["joints19"][:60])),
        BODY,
        "bodies[0].joints19",
    ),
    (panoptic.write, arrays(DETECTED, lambda a: {"poses2d": a["poses2d"][:, :, :17]}), DETECTED, "poses2d"),
    (
        panoptic.write,
        document(CALIBRATION, lambda d: d.update(cameras=[c for c in d["cameras"] if c["name"] != "00_10"])),
        CALIBRATION,
        "cameras",
    ),
    (
        lambda root: panoptic.write(root, per_camera=True),
        removed(f"2d_metrabs/S0/{SEQUENCE}/10/poses_filtered_4.npz"),
        "00_10/poses_filtered_4.npz",
        "file",
    ),
    (
        lambda root: panoptic.write(root, layout="skelsplat"),
        KEEP,
        "poses_filtered_4.npz",
        "truth",
        {"truth_unit": "m"},
    ),
    (
        panoptic.write,
        document(CALIBRATION, lambda d: in_metres(d["cameras"], 100)),
        CALIBRATION,
        "cameras",
    ),
    (
        panoptic.write,
        arrays(DETECTED, lambda a: {"poses2d": a["poses2d"][:, :, order_of(sk.layouts.PANOPTIC19)]}),
        DETECTED,
        "left and right",
    ),
    (panoptic.write, cut("poses_filtered_4.npz"), "poses_filtered_4.npz", "file"),
    (panoptic.write, cut(BODY, 0.3), BODY, "JSON"),
    (panoptic.write, arrays(DETECTED, lambda a: {"frames": a["frames"] + 5000}), DETECTED, "frames"),
    (panoptic.write, arrays(DETECTED, lambda _: {"frames": None}), DETECTED, "poses2d"),
    (panoptic.write, KEEP, "initial_guess/other", "file", {"monocular": "other"}),
    (panoptic.write, removed(f"{SEQUENCE}/{CALIBRATION}"), CALIBRATION, "file"),
]
OCCLUSION = [
    (
        occlusion_person.write,
        records(UNREAL, lambda rs: [r for r in rs if r["camera_id"] != 5]),
        UNREAL,
        "camera_id",
        {"views": 4},
    ),
    (authors, document("cameras.json", lambda d: d["4"].pop()), "cameras.json", "4", {"views": 4}),
    *(
        (
            occlusion_person.write,
            records(UNREAL, lambda rs, key=key: rs[9].update({key: rs[9][key][:14]})),
            UNREAL,
            f"[9].{key}",
        )
        for key in ("joints_gt", "joints_2d")
    ),
    (
        occlusion_person.write,
        arrays(PERSON, lambda a: {"poses2d": a["poses2d"][:, :, :14]}),
        PERSON,
        "poses2d",
    ),
    (occlusion_person.write, records(UNREAL, each(metres)), UNREAL, "truth"),
    (occlusion_person.write, records(UNREAL, each(translation)), UNREAL, "camera"),
    (
        occlusion_person.write,
        arrays(PERSON, lambda a: {"poses2d": a["poses2d"][:, :, order_of(sk.layouts.OCCLUSION_PERSON15)]}),
        PERSON,
        "left and right",
    ),
    (occlusion_person.write, cut(UNREAL), UNREAL, None),
    (occlusion_person.write, records(UNREAL, lambda rs: rs[0].update(scale=Fraction(1, 2))), UNREAL, None),
    (occlusion_person.write, arrays(PERSON, lambda a: {"poses2d": a["poses2d"][1:]}), PERSON, "poses2d"),
    (
        occlusion_person.write,
        records(UNREAL, lambda rs: rs[1].update(joints_gt=rs[1]["joints_gt"] + 50.0)),
        UNREAL,
        "[0].joints_gt",
    ),
    (
        authors,
        arrays("3d_gt/S0/validation 1/poses.npz", lambda a: {"poses3d": a["poses3d"][2:]}),
        "poses.npz",
        "poses3d",
    ),
    (
        authors,
        arrays("3d_gt/S0/validation 1/poses.npz", lambda _: {"frames": 1000 + np.arange(12)}),
        "poses.npz",
        "frames",
    ),
    (occlusion_person.write, removed(f"unrealcv/annot/{UNREAL}"), UNREAL, "file"),
]
SHELF = [
    (shelf, document("calibration_shelf.json", lambda d: d.pop("3")), "calibration_shelf.json", "cameras"),
    (
        shelf,
        lambda root: shelf_campus.write_actors(root / "actorsGT.mat", [np.ones((3, 13, 3))]),
        "actorsGT.mat",
        "actor3D{1}{1}",
    ),
    (
        shelf,
        lambda root: savemat(root / "actorsGT.mat", {"other": np.zeros(3)}),
        "actorsGT.mat",
        "actor3D",
    ),
    (shelf, lambda root: savemat(root / "actorsGT.mat", {"actor3D": 1.0}), "actorsGT.mat", "actor3D"),
    (shelf, cut("actorsGT.mat"), "actorsGT.mat", "file"),
    (shelf, removed("actorsGT.mat"), "actorsGT.mat", "file"),
    (shelf, arrays(ACTOR, lambda a: {"poses2d": a["poses2d"][:, :, :13]}), ACTOR, "poses2d"),
    (
        shelf,
        arrays(ACTOR, lambda a: {"poses2d": a["poses2d"][:, :, order_of(sk.layouts.SHELF14)]}),
        ACTOR,
        "left and right",
    ),
    (shelf, arrays(ACTOR, lambda a: {"poses2d": a["poses2d"][1:], "frames": None}), ACTOR, "poses2d"),
    (shelf, arrays(ACTOR, lambda a: {"frames": a["frames"] + 100}), ACTOR, "frames"),
    (everybody, arrays(EVERYBODY, lambda a: {"people": a["people"][:, :3]}), EVERYBODY, "people"),
    (everybody, arrays(EVERYBODY, lambda a: {"people": a["people"][..., :9, :]}), EVERYBODY, "people"),
    (everybody, arrays(EVERYBODY, lambda a: {"frames": 0 * a["frames"]}), EVERYBODY, "frames"),
    *(
        (pickled, records("pred_*.pkl", lambda _, content=content: content), "pred_shelf", field)
        for content, field in (
            ({"0-300": []}, "'0-300'"),
            ({"7_300": []}, None),
            ({"0_300": [{"box": 1}]}, "0_300[0].pred"),
            ({"0_300": [{"pred": [[1.0, 2.0]]}]}, "0_300[0].pred"),
            ([1], None),
        )
    ),
]
CASES = [
    pytest.param(name, *case, id=f"{name}-{k}")
    for name, cases in {
        "human36m": H36M,
        "panoptic": PANOPTIC,
        "occlusion-person": OCCLUSION,
        "shelf": SHELF,
    }.items()
    for k, case in enumerate((*one, {})[:5] for one in cases)
]


@pytest.mark.parametrize(("name", "write", "change", "file", "field", "options"), CASES)
def test_it_is_refused(tmp_path, name, write, change, file, field, options):
    write(tmp_path)
    if change is not None:
        change(tmp_path)
    given = {key: tmp_path / value if key == "detections" else value for key, value in options.items()}
    with pytest.raises(DatasetError) as caught:
        datasets.read(name, tmp_path, **given)
    assert file in str(caught.value.path)
    assert field in (None, caught.value.field)
    report = datasets.check(name, tmp_path, **given)
    assert not report.ok
    if change is not None and change.__qualname__.startswith("removed"):
        assert caught.value.path in [path for path, _ in report.survey.missing]


@pytest.mark.parametrize("layout", ["skelsplat", "karfly", "adafuse", "videopose3d"])
def test_a_forbidden_class_does_not_run(tmp_path, layout):
    class Bomb:
        def __reduce__(self):
            import os

            return os.mkdir, (str(tmp_path / "made"),)

    h36m(layout)(tmp_path)
    bomb = np.array({"S9": Bomb()}, dtype=object)
    if layout == "adafuse":
        (tmp_path / "annot" / ADAFUSE).write_bytes(pickle.dumps([Bomb()]))
    elif layout == "karfly":
        np.save(tmp_path / LABELS, bomb, allow_pickle=True)
    else:
        file, key = {"skelsplat": (POSES, "poses"), "videopose3d": (CPN, "positions_2d")}[layout]
        np.savez(tmp_path / file, **{key: bomb})
    with pytest.raises(DatasetError):
        datasets.read(
            "human36m", tmp_path, **({"detections": tmp_path / "2d_cpn"} if layout == "karfly" else {})
        )
    assert not (tmp_path / "made").exists()


@pytest.mark.parametrize(
    ("name", "options", "argument"),
    [
        ("human36m", {"detecter": "cpn"}, "detecter"),
        ("human36m", {"format": "coco"}, "format"),
        ("human36m", {"subjects": "S9"}, "subjects"),
        ("human36m-occ", {"variant": "4"}, "variant"),
        ("human37m", {}, "name"),
        ("occlusion-person", {"step": 0}, "step"),
        ("occlusion-person", {"views": 5}, "views"),
        ("panoptic", {"views": 9}, "views"),
        ("panoptic", {"truth_unit": "inch"}, "truth_unit"),
    ],
)
def test_options_that_do_not_exist(tmp_path, name, options, argument):
    with pytest.raises(InvalidInputError) as caught:
        datasets.read(name, tmp_path, **options)
    assert caught.value.argument == argument


def test_no_root_no_format_two_formats_and_no_subject(tmp_path):
    with pytest.raises(DatasetError) as caught:
        datasets.read("human36m", tmp_path / "nowhere")
    assert caught.value.field == "root"
    with pytest.raises(DatasetError) as caught:
        datasets.read("human36m", tmp_path)
    assert caught.value.field == "format"
    h36m("skelsplat")(tmp_path)
    with pytest.raises(DatasetError) as caught:
        datasets.read("human36m", tmp_path, subjects=("S1",))
    assert caught.value.field == "subjects"
    h36m("adafuse")(tmp_path)
    with pytest.raises(DatasetError) as caught:
        datasets.read("human36m", tmp_path)
    assert (caught.value.field, "adafuse" in caught.value.actual) == ("format", True)
    assert "skelsplat" in datasets.read("human36m", tmp_path, format="skelsplat", subjects=["S11"]).source
