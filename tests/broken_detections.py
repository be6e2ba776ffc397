"""Breaking one thing in a valid set of files of detections, and reading it."""

from __future__ import annotations

import json

import numpy as np
import pytest

import skelsplat as sk
from detection_cases import CASES
from detection_files import Take, deeplabcut_table
from skelsplat.io import read_detections

NAMES = ["camA", "camB"]
T, K = 3, 17


def anybody() -> np.ndarray:
    """Two people (T, M, 2, K, 3) anywhere in the image."""
    rng = np.random.default_rng(4)
    pixels = rng.uniform(10.0, 900.0, (T, 2, 2, K, 2))
    return np.concatenate([pixels, rng.uniform(0.3, 1.0, (T, 2, 2, K, 1))], axis=-1)


class Broken:
    """One file of the set of a case, and ways to break it."""

    def __init__(self, root, name):
        self.case, self.root = CASES[name], root
        people = anybody()
        kept = people if self.case.people else people[:, :, :1]
        self.joints = sk.layouts.get(self.case.layout).joints
        self.path = self.case.write(root, Take(kept, NAMES, list(self.joints)))
        found = sorted(path for path in root.rglob("*") if path.is_file() and "camB" in str(path))
        self.file = self.path if self.path.is_file() else found[-1]

    def cut(self):
        self.file.write_bytes(self.file.read_bytes()[:-400])

    def json(self, change):
        document = json.loads(self.file.read_text())
        document = change(document) or document
        self.file.write_text(json.dumps(document))

    def text(self, old, new):
        content = self.file.read_text()
        assert old in content
        self.file.write_text(content.replace(old, new, 1))

    def npz(self, **changes):
        with np.load(self.file, allow_pickle=True) as archive:
            arrays = {key: value for key, value in archive.items() if key not in changes}
        arrays |= {key: value for key, value in changes.items() if value is not None}
        np.savez(self.file, **arrays)

    def array(self, key):
        with np.load(self.file, allow_pickle=True) as archive:
            return archive[key].copy()

    def h5(self, change):
        import h5py

        with h5py.File(self.file, "a") as file:
            change(file)

    def dlc(self, change, *keys, **options):
        rng = np.random.default_rng(0)
        view = rng.uniform(0.0, 1.0, (T, 2, K, 3)) * [900.0, 900.0, 1.0]
        table = deeplabcut_table(view, self.joints, 0, multi=self.case.people)
        table = change(table)
        if self.file.suffix == ".csv":
            table.to_csv(self.file)
        else:
            self.file.unlink()
            for key in keys or ["df_with_missing"]:
                table.to_hdf(self.file, key=key, format="table", **options)

    def read(self):
        return read_detections(
            self.path, NAMES, layout=self.case.layout, format=self.case.format, order=self.case.order
        )


def column(table, part, coord):
    """Return the column of a part, of the first individual if there are several."""
    return next(c for c in table.columns if c[-2:] == (part, coord))


def above_one(table):
    table[column(table, "nose", "likelihood")] = 1.5
    return table


def renamed(table):
    return table.rename_axis(columns={"bodyparts": "parts"})


def without_x(table):
    return table.drop(columns=[column(table, "nose", "x")])


def check(tmp_path, capsys, name, change, field):
    """Read the valid set; the broken one ends in one line that names file and field; no code is run."""
    broken = Broken(tmp_path, name)
    assert broken.read().people.shape[3] == K
    change(broken)
    with pytest.raises(sk.DatasetError, match=f"{field}: expected") as caught:
        broken.read()
    assert caught.value.path == broken.file
    assert "\n" not in str(caught.value)
    assert capsys.readouterr().out == ""


def write_case(root, name, *, people, names=NAMES, joints=sk.layouts.H36M17.joints):
    """Write people (T, M, P, K, 3) in the format of a case; of one that knows one person only the first."""
    case = CASES[name]
    kept = people if case.people else people[:, :, :1]
    return case.write(root, Take(kept, list(names), list(joints)))


def first_joints(found):
    """X of the first frame's first person in each camera, (M, N)."""
    return found.people[0, :, 0, :, 0]


def fewest_twins(malformed) -> int:
    """How many malformed twins the format with the fewest has."""
    count = dict.fromkeys((CASES[name].format for name in malformed), 0)
    for name, twins in malformed.items():
        count[CASES[name].format] += len(twins)
    return min(count.values())
