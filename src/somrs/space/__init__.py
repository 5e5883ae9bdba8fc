"""The space of a building as geometry: the solids of its objects, free space, and ways through it."""
