"""Upgrades with running tasks: kills a system of the last release at a random moment, and restarts it with the current code.

Every running task has to continue and end as it should. The release is built from its commit, which the file `release` names, and runs
with the same Python and libraries.
"""
