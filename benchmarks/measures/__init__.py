"""One measurement per file; `accuracy.py` runs them."""
