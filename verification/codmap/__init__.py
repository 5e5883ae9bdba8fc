"""`make bench-codmap`: solves and executes published multi-agent planning problems with the whole system."""
