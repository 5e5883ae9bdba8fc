"""A planning task written for other solvers: SAS+, satisfiability, linear equations."""
