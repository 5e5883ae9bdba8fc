"""From a planning problem to a task with finitely many variables and moves: what is relevant, ground, and mutually exclusive."""
