"""Simulated Pioneer robots: the controller as the manuals describe it, on any body. It shares nothing with the driver."""
