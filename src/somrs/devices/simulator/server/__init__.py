"""The simulation as a server: its robots are driven over TCP, and it follows the map."""
