"""Who takes part in `coordination.py`: each holds the same conversations in a way of its own, in processes of its own."""
