"""Fleets with few chargers, busy for a long simulated time."""
