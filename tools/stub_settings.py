"""Write the settings of ``RefineConfig`` into the stub, from the core's table.

Run ``python tools/stub_settings.py`` after building the module (``maturin develop``). A test compares the
class's documentation and properties in the stub with those of the compiled module.
"""

from __future__ import annotations

import re
from pathlib import Path

from skelsplat import RefineConfig

STUB = Path(__file__).parents[1] / "python" / "skelsplat" / "_skelsplat.pyi"

# The table's types, as written in the stub.
_TYPES = {
    "float": "float",
    "int": "int",
    "bool": "bool",
    "float or None": "float | None",
    "int or None": "int | None",
    "(float, float)": "list[float]",
    "sequence of float, or None": "tuple[float, ...] | None",
    "float or sequence of float, or None": "float | tuple[float, ...] | None",
}

_METHODS = '''
    def __new__(cls, **fields: Any) -> RefineConfig: ...
    @staticmethod
    def paper(**fields: Any) -> RefineConfig:
        """{paper}"""
    def replace(self, **fields: Any) -> RefineConfig:
        """{replace}"""
    def to_dict(self) -> dict[str, Any]:
        """{to_dict}"""
    @staticmethod
    def settings(method: str = "annealed") -> list[Setting]:
        """{settings}"""
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...
    @property
    def method(self) -> str:
        """{method}"""
'''


def stub_class() -> str:
    """Return the class as the stub has it."""
    text = (RefineConfig.__doc__ or "").rstrip()
    body = "\n".join(f"    {line}".rstrip() for line in text.split("\n")).strip()
    names = ("paper", "replace", "to_dict", "settings", "method")
    methods = _METHODS.format(**{name: getattr(RefineConfig, name).__doc__ for name in names})
    out = f'@final\nclass RefineConfig:\n    """{body}\n    """\n{methods}'
    settings = {one.name: one.type for way in ("annealed", "paper") for one in RefineConfig.settings(way)}
    for name, kind in settings.items():
        annotation = "str" if kind.startswith("{") else _TYPES.get(kind, "float | str")
        out += f"    @property\n    def {name}(self) -> {annotation}: ...\n"
    return out


def main() -> None:
    """Replace the class in the stub."""
    text = STUB.read_text(encoding="utf-8")
    pattern = re.compile(r"@final\nclass RefineConfig:\n.*?(?=\n(?:@|def |class ))", re.DOTALL)
    found, count = pattern.subn(lambda _: stub_class(), text)
    assert count == 1, f"{STUB}: expected one class RefineConfig, got {count}"
    STUB.write_text(found, encoding="utf-8")


if __name__ == "__main__":
    main()
