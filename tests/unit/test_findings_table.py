"""docs/errors.md lists every kind of finding with its sentences."""

from __future__ import annotations

import re

import findings_table


def test_every_kind_of_finding_is_in_the_documentation_with_its_sentence():
    """If the page differs, run tools/findings_table.py."""
    assert findings_table.main(check=True) == 0
    page = findings_table.PAGE.read_text(encoding="utf-8")
    table = page.partition(findings_table.BEGIN)[2].partition(findings_table.END)[0]
    rows = [row.split(" | ") for row in table.strip().splitlines()[2:]]
    assert len(rows) > 50
    assert all(re.fullmatch(r"\| `[a-z_]+`", kind) and severity for kind, severity, _ in rows)
    assert [kind for kind, _, sentence in rows if sentence == "… |"] == ["| `remark`"]
