"""A jar washer in one file: a device type, a service type and a relation that the upper ontology does not have.

python examples/jar_washer.py --name Washer001
"""

import asyncio

from somrs import Device, Situation, Task, run, service
from somrs.ontology.services import Parameter, ServiceType
from somrs.ontology.types import ObjectType, RelationType

JAR_WASHER = ObjectType(
    name="JarWasher",
    parent="StationaryDevice",
    defaults={"Shape.Form": "Box", "Shape.Width": 0.6, "Shape.Depth": 0.6, "Shape.Height": 0.5, "Color": "White"},
    doc="Washes the jar that stands on it",
)
WAS_WASHED_BY = RelationType(name="wasWashedBy", joins=("Jar", "JarWasher"), functional=True)
WASH_JAR = ServiceType(
    name="WashJar",
    inputs=(Parameter(name="Jar", type="Jar"),),
    precondition="?Jar isOn ?Provider",
    effect="?Jar wasWashedBy ?Provider",
    doc="Wash a jar that stands on the washer",
)


class JarWasher(Device):
    """A washer at the position in `values`, which washes the jar that stands on it."""

    type = JAR_WASHER
    types = (WAS_WASHED_BY,)
    values = {"PositionX": 4.0, "PositionY": 6.5, "PositionZ": 0.0}

    @service(WASH_JAR, price="0.50 EUR", duration="2 s")
    async def wash(self, task: Task) -> Situation:
        await task.progress(0.1, note=f"water on, {task.inputs['Jar']} is in")
        await asyncio.sleep(1)
        await task.progress(0.7, note="drying")
        await asyncio.sleep(1)
        return None  # the arranged effect holds


if __name__ == "__main__":
    run(JarWasher)
