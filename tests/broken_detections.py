"""Breaking one thing in a valid set of files of detections, and reading it."""

from __future__ import annotations

import json

import numpy as np

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


def write_case(root, name, *, people, names=NAMES, joints=sk.layouts.H36M17.joints):
    """Write people (T, M, P, K, 3) in the format of a case; of one that knows one person only the first."""
    case = CASES[name]
    kept = people if case.people else people[:, :, :1]
    return case.write(root, Take(kept, list(names), list(joints)))


def first_joints(found):
    """X of the first frame's first person in each camera, (M, N)."""
    return found.people[0, :, 0, :, 0]


class Broken:
    """One file of the set of a case, and ways to break it."""

    def __init__(self, root, name):
        self.case, self.root = CASES[name], root
        self.joints = sk.layouts.get(self.case.layout).joints
        self.path = write_case(root, name, people=anybody(), joints=self.joints)
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

    def replace(self, old, new):
        self.file.write_text(self.file.read_text().replace(old, new))

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

    def dlc(self, change):
        rng = np.random.default_rng(0)
        view = rng.uniform(0.0, 1.0, (T, 2, K, 3)) * [900.0, 900.0, 1.0]
        table = change(deeplabcut_table(view, self.joints, 0, multi=self.case.people))
        if self.file.suffix == ".csv":
            table.to_csv(self.file)
        else:
            self.file.unlink()
            table.to_hdf(self.file, key="df_with_missing", format="table")

    def read(self):
        case = self.case
        return read_detections(self.path, NAMES, layout=case.layout, format=case.format, order=case.order)
