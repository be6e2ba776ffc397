"""Long recordings: read, solved and written in parts, in memory that hardly grows with them."""

from skelsplat.run.long._run import run_long

__all__ = ["run_long"]
