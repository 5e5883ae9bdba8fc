"""`make bench-codmap`: published multi-agent planning problems, played to their ends by the whole system."""
