"""Names that an author takes from the base classes by mistake are named when the class is made."""

from __future__ import annotations

import pytest

from somrs.devices import passage, road_robot
from somrs.errors import DeviceError

ASSIGNING = """
class Acme(RoadRobot):
    async def open(self) -> None:
        self._link = object()
        await super().open()
"""
ASSIGNING_IN_A_FUNCTION = """
class Acme(CarryingRobot):
    async def open(self) -> None:
        def note() -> None:
            self.battery = self.building = 1.0

        note()
"""
MIXED_IN = """
class Connected:
    def connect(self) -> None:
        self._road_link = object()

class Acme(Connected, RoadRobot):
    pass
"""
OWN = """
class Acme(CarryingRobot):
    can_charge = True
    _speed = 0.5

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.battery, self._way = 80.0, ()
        self.road.patience = self.acme = self.name

    async def follow(self, way: Way) -> None:
        self._way = way

class FasterAcme(Acme):
    _speed = 1.0

class Replacing(FasterAcme, replaces=("whole_map",)):
    whole_map = None
"""


def run_module(text: str) -> None:
    """What a file of an author does when it is imported; its types are not checked."""
    exec(text, {**vars(road_robot), **vars(passage), "__name__": "acme"})  # it is the tests' own text


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("class Acme(RoadRobot): map = 'floor plan'", "map (of Device)"),
        (ASSIGNING, "_link (of SimulatedDevice)"),
        (ASSIGNING_IN_A_FUNCTION, "building (of RoadRobot)"),
        ("class Acme(CarryingRobot):\n    def legs(self): return 4", "legs (of Manipulator)"),
        (MIXED_IN, "_road_link (of RoadRobot)"),
        ("class Acme(LiftDevice):\n    async def serve(self, call): self._move = call", "_move (of PassageDevice)"),
        ("class Acme(DoorDevice): _stays_open = True", "_stays_open (of DoorDevice)"),
    ],
)
def test_a_name_of_the_base_classes_is_refused(text: str, name: str) -> None:
    with pytest.raises(DeviceError) as error:
        run_module(text)
    assert str(error.value) == f"Acme uses names that its base classes use for something else: {name}; rename them"


def test_own_names_and_those_for_authors_are_taken() -> None:
    run_module(OWN)
