"""``python -m skelsplat`` and the command ``skelsplat``."""

import sys


def main() -> None:
    """Run `skelsplat.cli.main`; Ctrl-C while its imports are under way is status 130 without a traceback."""
    try:
        from skelsplat.cli import main as run

        run()
    except KeyboardInterrupt:
        sys.stderr.write("interrupted\n")
        sys.exit(130)


if __name__ == "__main__":
    main()
