"""Clients of a running system, and reports on its tasks and records."""
