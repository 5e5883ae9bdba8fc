"""The part in traffic of a device that is a lift or an automatic door: its address, and the work that traffic calls it for."""

from __future__ import annotations

import logging
import uuid

from msgspec import structs

from somrs.devices import passage
from somrs.devices.passage import PassageCall, PassageDevice
from somrs.errors import RemoteError
from somrs.kernel.component import Notified
from somrs.runtime.host import Host
from somrs.runtime.node import Node, Report
from somrs.traffic.passage_program import Complaint, PassageProgram, PassageStatus, Release, Serve

log = logging.getLogger(__name__)


async def _follow(device: PassageDevice, call: PassageCall | None) -> None:
    """Have the device moved. An error of the author's code is logged; the work is tried again."""
    try:
        await device.follow(call)
    except Exception:
        log.exception("%s could not be %s", device.name, "opened" if call is not None else "released")
        raise


def add_passage(runtime: Host, device: PassageDevice, traffic: str) -> Node:
    """Have a device take part in the traffic at an address."""

    async def carry_out(task: object, report: Report) -> object:
        match task:
            case Serve() | Release():
                await _follow(device, PassageCall(**structs.asdict(task)) if isinstance(task, Serve) else None)
            case Complaint(text):
                log.warning("%s does not take part in traffic: %s", device.name, text)
            case _:
                raise RemoteError(f"a passage cannot do {type(task).__name__}")
        return None

    def tell(status: passage.PassageStatus) -> None:
        node.feed(Notified(PassageStatus(level=status.level, working=status.working, shared=status.shared)))

    life = uuid.uuid4().hex
    node = runtime.add(f"/passages/{device.name}", lambda address: PassageProgram(device.name, address, traffic, life), carry_out=carry_out)
    device.status_observer = tell
    if device.current_status is not None:
        tell(device.current_status)
    return node
