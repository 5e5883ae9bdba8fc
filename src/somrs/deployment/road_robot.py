"""The part in traffic of a device that is a robot: its address, and what it is told there."""

from __future__ import annotations

import contextlib
import logging
import uuid

from somrs.devices.road.member import RoadMember
from somrs.errors import RemoteError
from somrs.kernel.component import Notified
from somrs.runtime.host import Host
from somrs.runtime.node import Node, Report
from somrs.runtime.reception import NotTaken
from somrs.traffic.robot_program import RobotProgram

log = logging.getLogger(__name__)


def add_road_robot(runtime: Host, device: RoadMember, name: str, traffic: str) -> Node:
    """Have a robot take part in the traffic at an address."""

    problem: str | None = None

    async def carry_out(task: object, report: Report) -> object:
        nonlocal problem
        try:
            outcome, problem = await device.road.carry_out(task), None
            return outcome
        except RemoteError as error:  # it is tried again; the log has it once
            if str(error) != problem:
                problem = str(error)
                log.warning("%s", problem)
            raise
        except Exception:  # an author's mistake may be anything; it is logged with its trace, and the work is tried again
            log.exception("%s could not do %s", name, type(task).__name__)
            raise

    life = uuid.uuid4().hex
    node = runtime.add(f"/robots/{name}", lambda address: RobotProgram(name, address, traffic, life), carry_out=carry_out)

    def tell(notice: object) -> None:
        with contextlib.suppress(NotTaken):  # the program is ending
            node.feed(Notified(notice))

    device.road.tell = tell
    return node
