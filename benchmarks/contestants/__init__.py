"""The contestants of `coordination.py`: each holds the same conversations in its own way, in its own processes."""
