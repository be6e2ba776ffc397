"""TRC files in the hands of other programs."""

from __future__ import annotations

import numpy as np
import pytest

from pose_sample import JOINTS, sample
from skelsplat.io import write_trc

# half a unit of the last digit: micrometres
DIGIT = 5.0001e-7


@pytest.fixture
def path(tmp_path):
    write_trc(tmp_path / "pose.trc", sample())
    return tmp_path / "pose.trc"


def test_opensim_reads_missing_markers_as_nan(path):
    """Its two readers of this format: of tables, which counts fields, and of marker data."""
    opensim = pytest.importorskip("opensim", reason="opensim is not installed (a wheel of 70 MB)")
    opensim.Logger.setLevelString("off")
    metres = sample().pose / 1000.0
    table = opensim.TimeSeriesTableVec3(str(path))
    assert table.getColumnLabels() == JOINTS
    assert table.getTableMetaDataString("Units") == "m"
    rows = [table.getRowAtIndex(t) for t in range(table.getNumRows())]
    read = [[[row[j][axis] for axis in range(3)] for j in range(row.ncol())] for row in rows]
    np.testing.assert_allclose(read, metres, atol=DIGIT)
    np.testing.assert_allclose(table.getIndependentColumn(), np.array([0, 1, 3, 4]) / 59.94, atol=DIGIT)
    markers = opensim.MarkerData(str(path))
    frames = [markers.getFrame(t) for t in range(markers.getNumFrames())]
    read = [[[frame.getMarker(j)[axis] for axis in range(3)] for j in range(3)] for frame in frames]
    np.testing.assert_allclose(read, metres, atol=DIGIT)


def test_pandas_reads_it_as_pose2sim_does(path):
    pandas = pytest.importorskip("pandas", reason="pandas is not installed")
    table = pandas.read_csv(path, sep="\t", skiprows=4)
    named = table.loc[:, ~table.columns.str.startswith("Unnamed")]
    assert list(named.columns) == [f"{axis}{n}" for n in (1, 2, 3) for axis in "XYZ"]
    assert table.iloc[:, 0].tolist() == [1, 2, 4, 5]
    np.testing.assert_allclose(named.to_numpy().reshape(4, 3, 3), sample().pose / 1000.0, atol=DIGIT)


def test_trc_data_reader_reads_header_and_whole_rows(path):
    """It splits lines at white space, so of rows with a missing marker it can only count the fields."""
    trc = pytest.importorskip("trc", reason="trc-data-reader is not installed")
    data = trc.TRCData()
    data.load(str(path))
    assert data["Markers"] == list(JOINTS)
    header = ("DataRate", "CameraRate", "NumFrames", "NumMarkers", "Units", "OrigDataStartFrame")
    assert [data[key] for key in header] == [59.94, 59.94, 4, 3, "m", 1]
    assert data["Frame#"] == [1, 2, 4, 5]
    for row, t in ((1, 0), (5, 3)):
        time, points = data[row]
        assert time == pytest.approx((row - 1) / 59.94, abs=DIGIT)
        np.testing.assert_allclose(points, sample().pose[t] / 1000.0, atol=DIGIT)
