"""``python -m skelsplat``: the same as the command ``skelsplat``."""

from skelsplat.cli import main

if __name__ == "__main__":
    main()
