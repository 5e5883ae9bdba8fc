"""The battery of a simulated robot: what drains it, and how fast it charges. Drivers use it, too, and so it imports nothing heavy."""

from __future__ import annotations

PER_METRE = 0.02
"""Charge that a metre of driving uses, percent: a full battery lasts for 5 km."""
PER_RADIAN = 0.005
"""Charge that turning by a radian uses, percent."""
PER_ARM_SECOND = 0.003
"""Charge that a second of moving a joint of the arm uses, percent."""
PER_SECOND = 0.0005
"""Charge that computer and sensors use in a second, whatever the robot does, percent: a full battery lasts for 55 hours."""
CHARGING = 0.05
"""Charge that a charger adds in a second, percent: an empty battery is full after 34 minutes."""


def charging_time(charge: float) -> float:
    """Seconds until a battery with this charge is full."""
    return (100.0 - charge) / (CHARGING - PER_SECOND)


class Battery:
    """The battery of a robot: its charge in percent, on the clock of the simulated world."""

    def __init__(self, charge: float, time: float) -> None:
        self.charge = min(max(charge, 0.0), 100.0)
        self._time = time

    def pass_time(self, time: float) -> None:
        """Drain the battery by what the robot uses in any case up to this time."""
        self.use(PER_SECOND * max(0.0, time - self._time))
        self._time = max(self._time, time)

    def use(self, charge: float) -> None:
        self.charge = max(0.0, self.charge - charge)

    def add(self, charge: float) -> None:
        self.charge = min(100.0, self.charge + charge)
