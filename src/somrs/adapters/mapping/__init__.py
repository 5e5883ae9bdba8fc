"""Robots that map: they explore floors of which there is no map, and what they see comes to the map."""
