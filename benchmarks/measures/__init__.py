"""What `accuracy.py` measures."""
