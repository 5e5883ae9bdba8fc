"""Simulated Pioneer robots: the controller as the manuals describe it, on any body. It shares nothing with the driver."""

from somrs.adapters.arcos.simulated.link_body import serve_simulated, simulated_robots

__all__ = ["serve_simulated", "simulated_robots"]
