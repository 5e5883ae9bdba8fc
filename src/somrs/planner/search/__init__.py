"""Search for plans: forward, by matching, with counters; and the smallest conflicting part of a goal."""
