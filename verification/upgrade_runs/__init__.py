"""Upgrades amid tasks: a system of the last release is killed at a random moment and started again with today's code.

Every task that was under way goes on and ends as it should. The release is built from its commit, which `release` names: the tree of
that commit, run with the same Python and libraries.
"""
