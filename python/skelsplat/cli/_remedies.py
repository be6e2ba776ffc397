"""What to give to ``refine`` for what ``check-cameras`` found."""

from __future__ import annotations

import shlex
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

    from skelsplat.io import DetectionSet
    from skelsplat.rig_check import CameraRow, Finding, RigReport


@dataclass(frozen=True)
class Remedies:
    """The options of ``refine`` that put findings right.

    Parameters
    ----------
    report
        What was found.
    found
        The detections that it was found in; None without any.
    offsets
        By camera, the offsets that these were read with.
    """

    report: RigReport
    found: DetectionSet | None = None
    offsets: Mapping[str, int] = field(default_factory=dict)

    def of(self, finding: Finding) -> list[str]:
        """Return the options and values for a finding; none if there is no option for it."""
        if finding.kind == "exchanged":
            return self._order(finding)
        if finding.kind == "offset":
            (row,) = (row for row in self.report.cameras if row.name == finding.cameras[0])
            return ["--offset", f"{row.name}={self.offset(row)}", *self._frames()]
        return []

    def line(self, finding: Finding) -> str:
        """Return the options as they are pasted into a shell; empty if there are none."""
        return shlex.join(self.of(finding))

    def offset(self, row: CameraRow) -> int | None:
        """Value of --offset that puts a camera in step, the one given included; None if it is in step."""
        return self._given(row.name) - row.best_offset if row.best_offset else None

    def _given(self, camera: str) -> int:
        """Return the offset with which the detections that belong to a camera were read."""
        return self.offsets.get(self._owners().get(camera, camera), 0)

    def _owners(self) -> dict[str, str]:
        """By camera, the one whose folder has its detections; empty if none are exchanged."""
        for finding in self.report.findings:
            if finding.kind == "exchanged":
                owners: dict[str, str] = finding.numbers["folders"]
                return owners
        return {}

    def _order(self, finding: Finding) -> list[str]:
        """Return --order with the labels that belong to the cameras, and offsets that move with them."""
        if self.found is None:
            return []
        label = dict(zip(self.found.camera_names, self.found.labels, strict=True))
        labels = [label[owner] or "" for owner in self._owners().values()]
        if any(text != text.strip() or not text or "," in text for text in labels):
            return []  # the option has no way to say it
        late = {row.name for row in self.report.cameras if row.best_offset}  # named in findings of their own
        moved = [
            option
            for name in finding.cameras
            if name not in late and self._given(name) != self.offsets.get(name, 0)
            for option in ("--offset", f"{name}={self._given(name)}")
        ]
        return ["--order", ",".join(labels), *moved]

    def _frames(self) -> list[str]:
        """Return what makes refine accept cameras of different frames, as late ones have."""
        return ["--frames", "intersection"] if self.found is not None and self.found.uneven else []
