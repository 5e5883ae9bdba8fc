"""The driver of a simulated vehicle, which only drives: a cleaning robot or a cart has neither a gripper nor a camera."""

from __future__ import annotations

from somrs.devices.simulator.drivers.mobile_robot import MobileRobot


class Vehicle(MobileRobot):
    """A mobile robot in the simulator that drives to places and charges its battery."""

    type = "Vehicle"
    features = ("Speed", "Price")
    look_at_place = look_into = None
