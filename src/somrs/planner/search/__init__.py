"""Search for plans: heuristic forward search, matching of short chains, search with counters; and minimal conflicts of a goal."""
