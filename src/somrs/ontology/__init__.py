"""The shared vocabulary of a building: attributes, relations, types, objects, maps, service types, and what is true."""
