"""Somebody at a screen who can be asked, as a device."""
