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

# The class in the stub, of which the documentation and the properties are replaced.
_CLASS = re.compile(
    r'(?P<head>class RefineConfig:\n    """).*?(?P<rest>\n    """\n.*?)(?:    @property\n[^\n]* \.\.\.\n)+',
    re.DOTALL,
)


def properties() -> str:
    """Return a property per setting."""
    out = ""
    for one in [*RefineConfig.settings("annealed"), *RefineConfig.settings("paper")]:
        annotation = "str" if one.type.startswith("{") else _TYPES.get(one.type, "float | str")
        written = f"    @property\n    def {one.name}(self) -> {annotation}: ...\n"
        out += written * (written not in out)
    return out


def main() -> None:
    """Replace the documentation and the properties of the class in the stub."""
    text = STUB.read_text(encoding="utf-8")
    own = "\n".join(f"    {line}".rstrip() for line in (RefineConfig.__doc__ or "").splitlines()).strip()
    found, count = _CLASS.subn(lambda match: f"{match['head']}{own}{match['rest']}{properties()}", text)
    assert count == 1, f"{STUB}: expected one class RefineConfig, got {count}"
    STUB.write_text(found, encoding="utf-8")


if __name__ == "__main__":
    main()
