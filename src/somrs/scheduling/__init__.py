"""Tasks that are stated again and again by themselves: templates, standing orders, and the scheduler that states them when they are due."""
