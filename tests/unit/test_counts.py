"""The size of the code stays within its limits, and `tools/counts.py` counts correctly."""

from __future__ import annotations

from pathlib import Path

import pytest

import counts
import import_circles
from import_circles import circles, python_graph, rust_graph

ROWS = {row.name: row for row in counts.folders()}


# Lines of the package without what came later, and what each later capability may add.
HOUSE = 29_500
LATER = {"sequences": 1_600, "people": 5_510, "recordings": 5_540, "trust": 3_640}


def test_the_package_is_small() -> None:
    assert ROWS["package"].lines <= HOUSE + sum(LATER.values())


def test_the_command_line_is_small() -> None:
    assert ROWS["package: cli"].files <= 26
    assert ROWS["package: cli"].lines <= 4500


def test_the_binding_is_thin() -> None:
    assert counts.binding_ratio() <= 0.22


def test_long_functions_have_a_reason() -> None:
    assert [function for function in counts.long_functions() if function.reason is None] == []


def test_nine_functions_lie_between_the_argument_and_the_inner_loop() -> None:
    assert counts.broken_rooms() == []
    assert len(counts.ROOMS) <= counts.MOST_ROOMS == 9
    (inner,) = counts.ROOMS[-1].bodies()
    assert "for ray in " in inner


def test_a_missing_room_and_a_call_that_is_not_made_are_named() -> None:
    first, second, third, fourth, *_ = counts.ROOMS
    assert counts.broken_rooms((first, second, fourth)) == []  # the closure is written there
    assert counts.broken_rooms((first, third)) == ["python/skelsplat/_refine.py: refine does not call run"]
    passing = counts.Room(third.file, third.name, closure="job")
    assert counts.broken_rooms((first, second, passing, fourth)) == [f"{third.file}: run does not call job"]
    gone = counts.Room(fourth.file, "gone")
    assert counts.broken_rooms((first, gone)) == [
        f"{fourth.file}: no function gone",
        "python/skelsplat/_refine.py: refine does not call gone",
    ]


def test_a_circle_is_found_and_a_chain_is_none() -> None:
    chain = {("a",): {("b",)}, ("b",): {("c",)}, ("c",): set()}
    assert circles(chain) == []
    assert circles({**chain, ("c",): {("a",)}, ("d",): {("a",)}}) == [[("a",), ("b",), ("c",)]]


def test_rust_imports_are_followed_to_the_file_that_defines_the_name(tmp_path: Path) -> None:
    for name, text in {
        "lib.rs": "pub mod one; mod two;",
        "one/mod.rs": "mod inner;\npub use inner::{Thing, other::Self as X};\npub use self::inner::last;",
        "one/inner.rs": "use super::super::two::{self, f};\n// use crate::one;\npub struct Thing;",
        "two.rs": "use crate::{one::{Thing, last as l}, std};\n#[cfg(test)]\nmod tests { use crate::lib; }",
    }.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    graph = rust_graph(tmp_path)
    assert graph["two",] == {("one", "inner"), ()}
    assert graph["one", "inner"] == {("two",)}
    assert circles(graph) == [[("one", "inner"), ("two",)]]


def test_python_imports_are_followed_and_those_of_functions_do_not_count(tmp_path: Path) -> None:
    root = tmp_path / "p"
    root.mkdir()
    for name, text in {
        "__init__.py": "from p._a import A\nfrom p.b import B\n",
        "_a.py": "from p import B\n",
        "b.py": "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from p import A\n"
        "def f():\n    from p import A\n",
    }.items():
        (root / name).write_text(text, encoding="utf-8")
    assert python_graph(root) == {("p",): set(), ("p", "_a"): {("p", "b")}, ("p", "b"): set()}
    (root / "b.py").write_text("from . import A\n", encoding="utf-8")
    assert circles(python_graph(root)) == [[("p", "_a"), ("p", "b")]]


RUST = """\
// long: told so
#[inline]
pub fn a<T>(x: [u8; 3]) -> u8 {
    // }
    let brace = '}';
    "}"
}
    const fn b();
#[cfg(test)]
mod tests { fn c() {} }
"""


def test_functions_are_measured() -> None:
    assert list(counts._rust_functions(RUST)) == [("a", 3, 5), ("b", 8, 1)]
    assert counts._reason(RUST.splitlines(), 3) == "told so"
    assert counts._reason(RUST.splitlines(), 8) is None
    python = (
        '# long: because\n@one\n@two\ndef f(\n    a,\n):\n    """Say.\n\n    More.\n    """\n    return a\n'
    )
    assert list(counts._python_functions(python)) == [("f", 2, 4)]
    assert counts._reason(python.splitlines(), 2) == "because"


@pytest.mark.sweep
@pytest.mark.parametrize("arguments", [["--markdown"], []])
def test_everything_is_printed(
    arguments: list[str], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", ["counts.py", *arguments])
    counts.main()
    said = capsys.readouterr().out
    assert "package: cli" in said
    assert "binding / core: 0." in said
    assert said.startswith("| folder |") == bool(arguments)
    assert arguments or import_circles.main() in (0, 1)
