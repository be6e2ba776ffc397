"""Whatever stands in place of a value, a reader gives data or an error of the package, nothing else."""

from __future__ import annotations

import copy
import json
import pickle
import random

import numpy as np
import pytest

from skelsplat import SkelSplatError, datasets
from writers import human36m as write

JUNK = (
    *(None, 3, -1, True, "x", [], {}, [[1, 2], [3]], {"a": 1}, float("nan"), float("inf")),
    *(np.zeros(3), np.array("a"), np.zeros((0, 17, 3)), np.array([None, 1], dtype=object)),
)
CASES = 40


def places(value, place=()):
    """Paths to all values of nested tables and lists (of a list, the first two)."""
    yield place
    keys = value if isinstance(value, dict) else range(min(2, len(value))) if isinstance(value, list) else ()
    for key in keys:
        yield from places(value[key], (*place, key))


def spoiled(value, place, junk):
    """Return a copy with one value replaced."""
    if not place:
        return junk
    out = copy.deepcopy(value)
    inner = out
    for key in place[:-1]:
        inner = inner[key]
    inner[place[-1]] = junk
    return out


def small():
    recording = write.record(frames=2)
    recording.takes = [take for take in recording.takes if take.action == "Directions"]
    return recording


def content(name, root):
    """Give the content of the files of a layout, and a function that writes another in its place."""
    recording = small()
    if name == "karfly":
        path = write.write_karfly(root, recording)

        def save(value):
            box = np.empty((), dtype=object)
            box[()] = value
            np.save(path, box, allow_pickle=True)

        return write.karfly_labels(recording), save
    if name == "adafuse":
        path = write.write_adafuse(root, recording)
        return write.adafuse_records(recording), lambda value: path.write_bytes(pickle.dumps(value))
    if name == "cameras":
        write.write_skelsplat(root, recording)
        path = root / "cameras" / "camera-parameters.json"
        return json.loads(path.read_text()), lambda value: path.write_text(
            json.dumps(value, default=lambda array: array.tolist())
        )
    write.write_videopose3d(root, recording)
    key, path = {
        "positions_3d": ("positions_3d", root / "data_3d_h36m.npz"),
        "positions_2d": ("positions_2d", root / "data_2d_h36m_cpn_ft_h36m_dbb.npz"),
    }[name]

    def savez(value):
        box = np.empty((), dtype=object)
        box[()] = value
        np.savez(path, **{key: box})

    return np.load(path, allow_pickle=True)[key].item(), savez


@pytest.mark.parametrize("name", ["karfly", "adafuse", "cameras", "positions_3d", "positions_2d"])
def test_malformed_values(tmp_path, name):
    good, save = content(name, tmp_path)
    rng = random.Random(name)
    cases = [(place, junk) for place in places(good) for junk in JUNK]
    refused = 0
    for place, junk in rng.sample(cases, min(CASES, len(cases))):
        save(spoiled(good, place, junk))
        try:
            datasets.read("human36m", tmp_path)
        except SkelSplatError as error:
            refused += 1
            message = str(error)
        else:
            continue
        assert str(tmp_path) in message, (place, junk)
    assert refused > CASES / 3
