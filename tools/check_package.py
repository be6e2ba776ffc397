"""Install a wheel or an sdist into an empty environment and use it there, as a stranger would.

    python tools/check_package.py dist/*.whl              # no Rust: the environment is all there is in PATH
    python tools/check_package.py dist/*.tar.gz           # built there, with the Rust of this machine
    python tools/check_package.py                         # what this interpreter has installed

The environment is one of this interpreter. Needs the standard library alone, so it also runs in the
containers that build wheels.
"""

from __future__ import annotations

import importlib.metadata
import importlib.util
import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

LICENCES = ("LICENSE", "LICENSE.pose2sim", "third-party.yml", "rust-std.txt")
# What is said where an extra is absent.
NEEDS_VIZ = "pip install 'skelsplat[viz]'"


def main() -> None:
    """Check the package given, or what is installed here."""
    for package in sys.argv[1:]:
        check_package(Path(package).resolve())
    if not sys.argv[1:]:
        check_installed()


def check_package(package: Path) -> None:
    """Install the package into an empty environment and check it there."""
    with tempfile.TemporaryDirectory(prefix="skelsplat-package-") as folder:
        home = Path(folder) / "env"
        subprocess.run([sys.executable, "-m", "venv", home], check=True)
        scripts = home / ("Scripts" if os.name == "nt" else "bin")
        environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
        if package.suffix == ".whl":
            environment["PATH"] = str(scripts)
            compilers = [name for name in ("cargo", "cc") if shutil.which(name, path=str(scripts))]
            expect(not compilers, f"no compiler in the empty environment, got {compilers}")
        here = scripts / ("python.exe" if os.name == "nt" else "python")
        install = [here, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", package]
        subprocess.run(install, check=True, env=environment, cwd=folder)
        check = [here, Path(__file__).resolve()]
        status = subprocess.run(check, check=False, env=environment, cwd=folder).returncode
    expect(status == 0, f"a package that works, got {package.name}")


def check_installed() -> None:
    """Use the package that this interpreter finds; its folder must not be the source's."""
    with tempfile.TemporaryDirectory(prefix="skelsplat-check-") as folder:
        os.chdir(folder)
        check_version()
        inside = {path.name for path in importlib.metadata.files("skelsplat") or []}
        missing = {"py.typed", "_skelsplat.pyi", *LICENCES, "skelsplat.cdx.json"} - inside
        expect(not missing, f"types, licences and the bill of materials in the package, not {missing}")
        check_arrays()
        check_commands(Path(folder))
    print("works")


def check_version() -> None:
    """Check that the installed module is used, is of one version, and does not turn the GIL on."""
    import skelsplat
    from skelsplat import _skelsplat

    module = Path(_skelsplat.__file__)
    gil = getattr(sys, "_is_gil_enabled", lambda: True)()
    print(f"skelsplat {skelsplat.__version__} ({module.name}), Python {sys.version}, with GIL: {gil}")
    expect(module.is_relative_to(sysconfig.get_path("platlib")), f"the installed module, not {module}")
    one_version = skelsplat.__version__ == importlib.metadata.version("skelsplat")
    expect(one_version, "one version in code and metadata")
    # Importing a module that does not declare that it needs no GIL turns it on again.
    expect(not (gil and sysconfig.get_config_var("Py_GIL_DISABLED")), "the GIL off in a free-threaded build")


def check_arrays() -> None:
    """Refine simulated detections here and in eight threads at once: the same bits, close to the truth."""
    import skelsplat as sk
    from skelsplat import synthetic

    rig, truth = synthetic.human36m_like(), synthetic.motion("walk", 10, seed=0)
    good = synthetic.DetectionNoise.good()
    seen = synthetic.simulate_detections(truth, rig, noise=good, seed=0)

    def again(_: int) -> bytes:
        return sk.refine(None, seen, rig, layout="h36m17").pose.tobytes()

    alone = sk.refine(None, seen, rig, layout="h36m17").pose
    error = sk.metrics.mpjpe(alone, truth)
    expect(error < sk.metrics.mpjpe(sk.triangulate(seen, rig, method="dlt"), truth), "an error below DLT's")
    with ThreadPoolExecutor(8) as threads:
        expect(set(threads.map(again, range(8))) == {alone.tobytes()}, "the same bits in 8 threads")


def check_commands(folder: Path) -> None:
    """`demo`, `refine` from the files that it writes, and the message where an extra is absent."""
    import numpy as np

    run("demo", "--no-adjust", "-o", "demo", "--quiet")
    given = "demo/input/Calib.toml demo/input/openpose --unit m --layout body25b --fps 60 -o out --quiet"
    run("refine", *given.split())
    with np.load(folder / "demo/pose.npz") as one, np.load(folder / "out/pose.npz") as two:
        for name in ("pose", "error_bar"):
            expect(np.array_equal(one[name], two[name], equal_nan=True), f"{name} of demo and refine alike")
    if importlib.util.find_spec("matplotlib") is None:
        said = run("plot", "out", status=1)
        expect(NEEDS_VIZ in said, f"{NEEDS_VIZ} in {said!r}")


def run(*arguments: str, status: int = 0) -> str:
    """Run the command that was installed, check its exit status, and return its errors."""
    command = shutil.which("skelsplat", path=sysconfig.get_path("scripts"))
    expect(command is not None, "the command skelsplat")
    done = subprocess.run([str(command), *arguments], capture_output=True, text=True, check=False)
    expect(done.returncode == status, f"status {status} of skelsplat {arguments[0]}, got {done.stderr}")
    return done.stderr


def expect(held: bool, what: str) -> None:
    """End with a message unless it holds."""
    if not held:
        sys.exit(f"expected {what}")


if __name__ == "__main__":
    main()
