"""Mutation tests: makes small changes to the core, one at a time, and checks that a test fails for each.

`mutations` defines the changes, `tree` holds a copy of the project with a mutant, `record` records which tests reach which lines, `runner`
runs tests in such a copy, and `trial` runs the tests that reach a mutant.
"""
