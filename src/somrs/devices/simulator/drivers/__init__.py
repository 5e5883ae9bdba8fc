"""The drivers of the simulated robots and cameras."""
