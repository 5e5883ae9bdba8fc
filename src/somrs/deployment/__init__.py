"""Which processes make a system, how they start, stop and are kept running."""
