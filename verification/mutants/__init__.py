"""Whether the tests would notice: small changes are made to the core, one at a time, and each has to make a test fail.

`mutations` says what is changed, `tree` keeps a copy of the project in which it is, `record` knows which tests reach which lines,
`runner` runs tests in such a copy, and `trial` puts a mutant through those that reach it.
"""
