"""Deliveries in whole buildings: imports a building, and has robots carry jars between places that they reach, also across storeys."""
