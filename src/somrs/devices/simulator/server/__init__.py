"""The simulation as a server: clients control its robots over TCP, and it follows changes of the map."""
