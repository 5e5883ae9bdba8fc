"""Maps that robots make: occupancy grids become buildings, and robots explore."""
