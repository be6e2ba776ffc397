"""The site builds without a warning, and leaves no link and no public name out."""

from __future__ import annotations

import importlib
import runpy
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
import typer.main

import skelsplat as sk
from skelsplat.cli import app
from sweeps import swept

DOCS = Path(__file__).parents[2] / "docs"
MODULES = (
    "skelsplat",
    "skelsplat.io",
    "skelsplat.detect",
    "skelsplat.metrics",
    "skelsplat.synthetic",
    "skelsplat.rig_check",
    "skelsplat.datasets",
    "skelsplat.evaluation.baselines",
)
# Without furo and the index of words, a third of the time, and without collecting garbage, a sixth.
PLAIN = """
import gc, sys
from sphinx.builders.html import StandaloneHTMLBuilder
from sphinx.cmd.build import main
StandaloneHTMLBuilder.search = False
gc.disable()
sys.exit(main(sys.argv[1:]))
"""
# without a docstring of their own: formats.md has the layouts
CONSTANTS = {*(name.upper() for name in sk.layouts.names), "__version__"}


class Page(HTMLParser):
    """Where a page links to, and what can be linked to in it."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.links: list[str] = []
        self.anchors: set[str] = set()
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attrs}
        self.anchors |= {given[name] for name in ("id", "name") if name in given}
        if tag == "a" and "href" in given:
            self.links.append(given["href"])


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    target = tmp_path_factory.mktemp("site")
    package = str(Path(sk.__file__).parents[1])
    options = ["-W", "-n", "--keep-going", "-q", "-D", "html_theme=basic", str(DOCS), str(target)]
    command = [sys.executable, "-c", PLAIN, *options]
    done = subprocess.run(
        command, env={"PATH": "", "PYTHONPATH": package}, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return target


@pytest.fixture(scope="module")
def pages(site: Path) -> dict[Path, Page]:
    return {path: Page(path) for path in site.rglob("*.html")}


def test_every_link_within_the_site_leads_somewhere(pages: dict[Path, Page]) -> None:
    broken = []
    for path, page in pages.items():
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            anchors = pages[target].anchors if target in pages else set()
            if not target.exists() or (parts.fragment and unquote(parts.fragment) not in anchors):
                broken.append(f"{path.name}: {link}")
    assert broken == []


@pytest.mark.parametrize("module", MODULES)
def test_every_public_name_is_documented(module: str, pages: dict[Path, Page]) -> None:
    known = set().union(*(page.anchors for page in pages.values()))
    names = [f"{module}.{name}" for name in importlib.import_module(module).__all__ if name not in CONSTANTS]
    assert [name for name in names if not known & {name, f"module-{name}"}] == []


def test_every_command_and_option_is_documented(site: Path) -> None:
    anchors = Page(site / "commands.html").anchors
    commands = typer.main.get_command(app).commands
    groups = {name: group for name, group in commands.items() if hasattr(group, "commands")}
    leaves = {name: command for name, command in commands.items() if name not in groups}
    leaves |= {
        f"{name}-{part}": leaf for name, group in groups.items() for part, leaf in group.commands.items()
    }
    wanted = {f"command-{name}" for name in leaves} | {
        f"cmdoption-{name}-{option.lstrip('-') if option.startswith('-') else f'arg-{param.metavar}'}"
        for name, command in leaves.items()
        for param in command.params
        if param.name != "help"
        for option in param.opts
    }
    assert wanted - anchors == set()


@pytest.mark.parametrize("script", ["method", swept("sample")])
def test_figures_are_what_the_scripts_draw(
    script: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What they measure does not matter here: one step instead of hundreds."""
    refine = sk.refine
    monkeypatch.setattr(
        sk, "refine", lambda *a, config, **b: refine(*a, config=config.replace(max_steps=1), **b)
    )
    monkeypatch.setenv("PYTHONPATH", str(Path(sk.__file__).parents[1]))
    runpy.run_path(str(DOCS / "figures" / f"{script}.py"))["main"](tmp_path)
    drawn = {path.name for path in tmp_path.glob("*.png")}
    assert drawn
    assert drawn <= {path.name for path in (DOCS / "figures").glob("*.png")}
