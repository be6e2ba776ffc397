"""Write licenses/skelsplat.cdx.json, what the compiled module consists of, by `cargo cyclonedx`.

    python tools/sbom.py      # needs cargo-cyclonedx, from crates.io

Without time, random number and paths of this machine, so that it changes only with Cargo.lock.
"""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

ROOT = Path(__file__).parents[1]
CRATE = ROOT / "crates/skelsplat-py"
NAME = "skelsplat.cdx"


def main() -> None:
    """Write the file."""
    command = ["cargo", "cyclonedx", "--format", "json", "--spec-version", "1.5", "--target", "all"]
    manifest = ["--manifest-path", str(CRATE / "Cargo.toml"), "--override-filename", NAME]
    subprocess.run([*command, *manifest], cwd=ROOT, check=True)
    # It writes one for every crate of the workspace.
    written = CRATE / f"{NAME}.json"
    document = json.loads(written.read_text(encoding="utf-8").replace(ROOT.as_uri(), "file://."))
    for path in ROOT.glob(f"crates/*/{NAME}.json"):
        path.unlink()
    document.pop("serialNumber", None)
    document["metadata"].pop("timestamp", None)
    text = json.dumps(document, indent=1, ensure_ascii=False) + "\n"
    (ROOT / "licenses" / f"{NAME}.json").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
