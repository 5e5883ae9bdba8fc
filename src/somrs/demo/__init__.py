"""Demonstrations: the paper's scenarios, run by a whole system in the simulator."""
