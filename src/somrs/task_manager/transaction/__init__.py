"""One task from what its client states to its end: a transaction."""
