"""The simulated world built from the map: shapes, bodies, physics, cameras and vision."""
