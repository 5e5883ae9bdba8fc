"""The robot link: commands to simulated robots, and their states, as JSON lines over TCP."""
