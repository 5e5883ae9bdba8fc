"""The world made from the map: shapes, bodies, cameras, and what can be seen."""
