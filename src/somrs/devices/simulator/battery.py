"""The battery of a simulated robot: what drains it, and how fast it charges. Drivers use it, too, and so it imports nothing heavy."""

from __future__ import annotations

CONSUMPTION = 0.02
"""Charge that the base uses for a metre of driving, percent: a full battery lasts for 5 km."""
CHARGING = 0.05
"""Charge that a charger adds in a second, percent: an empty battery is full after 33 minutes."""
