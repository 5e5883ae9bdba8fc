"""The part in traffic of a device that is a lift or an automatic door: its address, and the work that traffic calls it for."""

from __future__ import annotations

import logging
import uuid

from somrs.devices.passage import PassageDevice
from somrs.errors import RemoteError
from somrs.kernel.component import Notified
from somrs.runtime.host import Host
from somrs.runtime.node import Node, Report
from somrs.traffic.passage_call import PassageCall, PassageStatus
from somrs.traffic.passage_program import Complaint, PassageProgram, Release

log = logging.getLogger(__name__)


async def _follow(device: PassageDevice, call: PassageCall | None) -> None:
    """Have the device moved."""
    try:
        await device.follow(call)
    except Exception:  # an author's mistake may be anything; it is logged with its trace, and the work is tried again
        log.exception("%s could not be %s", device.name, "opened" if call is not None else "released")
        raise


def add_passage(runtime: Host, device: PassageDevice, traffic: str) -> Node:
    """Have a device take part in the traffic at an address."""

    async def carry_out(task: object, report: Report) -> object:
        match task:
            case PassageCall() | Release():
                await _follow(device, task if isinstance(task, PassageCall) else None)
            case Complaint(text):
                log.warning("%s does not take part in traffic: %s", device.name, text)
            case _:
                raise RemoteError(f"a passage cannot do {type(task).__name__}")
        return None

    def tell(status: PassageStatus) -> None:
        node.feed(Notified(status))

    life = uuid.uuid4().hex
    node = runtime.add(f"/passages/{device.name}", lambda address: PassageProgram(device.name, address, traffic, life), carry_out=carry_out)
    device.status_observer = tell
    if device.current_status is not None:
        tell(device.current_status)
    return node
