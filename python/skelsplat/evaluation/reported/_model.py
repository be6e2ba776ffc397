"""A published table and its rows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from skelsplat.exceptions import InvalidInputError


@dataclass(frozen=True, slots=True)
class ReportedRow:
    """One row of a published table.

    Attributes
    ----------
    method : str
        As this package writes it: the same method has the same name in every table.
    detector : str or None
        Where the 2D keypoints come from: ``"metrabs"``, ``"cpn"``, ``"resnet152"``, ``"resnet50"``; None: the
        table does not say.
    citation : str
        Authors, title, venue and year.
    truth_3d : bool or None
        Whether it was trained with 3D ground truth; None: not known.
    training : str or None
        The data set it was trained on, where the table says.
    setting : mapping of str to str
        What else tells the row from others: ``{"init": "fusion"}``.
    keys : tuple of str
        Names of the C columns, for `value`.
    values : tuple of float or None
        C numbers in the table's unit; None where the table has none.
    """

    method: str
    detector: str | None
    citation: str
    truth_3d: bool | None
    training: str | None
    setting: Mapping[str, str]
    keys: tuple[str, ...]
    values: tuple[float | None, ...]

    def value(self, key: str) -> float | None:
        """Return the number in the column `key`; None if the table leaves it out.

        Raises
        ------
        InvalidInputError
            If there is no such column.
        """
        if key not in self.keys:
            raise InvalidInputError(f"key: expected one of {', '.join(self.keys)}, got {key!r}")
        return self.values[self.keys.index(key)]


@dataclass(frozen=True, slots=True)
class ReportedTable:
    """A published table.

    Attributes
    ----------
    label : str
        ``"tab:h36m"``: the paper's label; ``"text:…"``: said in its text; else ``"publication:data set"``.
    title, source : str
    dataset : str
        As in the registry of `skelsplat.datasets`.
    metric, unit : str
    columns : tuple of str
        C headers as printed.
    keys : tuple of str
        The same columns by the names that this package uses: actions, numbers of views, settings.
    rows : tuple of ReportedRow
    notes : tuple of str
        What to know before comparing.
    """

    label: str
    title: str
    source: str
    dataset: str
    metric: str
    unit: str
    columns: tuple[str, ...]
    keys: tuple[str, ...]
    rows: tuple[ReportedRow, ...]
    notes: tuple[str, ...] = field(default=())

    def __iter__(self) -> Iterator[ReportedRow]:
        return iter(self.rows)

    def select(
        self, method: str | None = None, *, detector: str | None = None, **setting: str
    ) -> tuple[ReportedRow, ...]:
        """Return the rows of a method, a detector, a setting: ``select("SkelSplat", init="dlt")``."""
        return tuple(
            row
            for row in self.rows
            if (method is None or row.method == method)
            and (detector is None or row.detector == detector)
            and all(row.setting.get(name) == value for name, value in setting.items())
        )

    def one(self, method: str | None = None, *, detector: str | None = None, **setting: str) -> ReportedRow:
        """Return the only row that `select` finds.

        Raises
        ------
        InvalidInputError
            If there is none or more than one.
        """
        found = self.select(method, detector=detector, **setting)
        if len(found) != 1:
            asked = {"method": method, "detector": detector, **setting}
            raise InvalidInputError(f"{self.label}: expected one row with {asked}, got {len(found)}")
        return found[0]
