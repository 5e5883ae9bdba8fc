"""Zones of VDA 5050 3.0, made of what the map says about the building."""
