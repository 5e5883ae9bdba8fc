"""Motion of simulated robots: path planning, driving, giving way, gripping and placing."""
