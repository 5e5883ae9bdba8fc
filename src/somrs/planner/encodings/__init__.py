"""Encodings of a planning task for other solvers: SAS+, propositional satisfiability, linear inequalities."""
