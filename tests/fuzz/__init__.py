"""Random inputs: mutated files, odd arrays and odd options. See `fuzz.__main__`."""
