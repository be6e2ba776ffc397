"""Attack the library and print the results: the figures of docs/reliability.md.

    python benchmarks/reliability.py [NAME ...] [--markdown]

Every attack runs in its own process with a time limit, so that one that hangs or aborts is still a row of the
table. Run it with the Python of another environment to measure another version.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

import common
from attacks import Attack, attacks

import skelsplat as sk

_CHILD = "--child"


def outcome(attack: Attack) -> str:
    """Run one attack in its own process; return its result, or how it ended."""
    command = [sys.executable, str(Path(__file__).resolve()), _CHILD, attack.name]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=attack.limit_s, check=False, errors="replace"
        )
    except subprocess.TimeoutExpired:
        return f"no answer within {attack.limit_s:.0f} s"
    if done.returncode < 0:
        return f"process ended by signal {-done.returncode}"
    if done.returncode > 0:
        last = done.stderr.strip().splitlines() or ["no message"]
        return last[-1][:160]
    return done.stdout.strip()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help="only these attacks")
    parser.add_argument("--markdown", action="store_true", help="print a Markdown table")
    parser.add_argument(_CHILD, action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    known = {a.name: a for a in attacks()}
    unknown = [name for name in options.names if name not in known]
    if unknown:
        parser.error(f"no attack called {unknown[0]!r}; there are {', '.join(known)}")
    chosen = [known[name] for name in options.names] or list(known.values())
    if options.child:
        print(chosen[0].run())
        return
    rows = [[a.order, a.what, a.ideal, outcome(a)] for a in chosen]
    title = f"Attacks, skelsplat {sk.__version__}"
    common.show(title, ["", "attack", "right", "measured"], rows, markdown=options.markdown)
    print(common.circumstances())


if __name__ == "__main__":
    main()
