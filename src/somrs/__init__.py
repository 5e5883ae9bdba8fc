"""SO-MRS: robots and devices of any make accomplish tasks that are stated as formulas about a building.

The public names are here. To write a device: `Device`, `service`, `Task`, `Situation`, `Refusal`, `ServiceFailed`, and `run`; for a lift or
a door, `LiftDevice`, `DoorDevice` and `PassageCall`. To use a running system from a program: `Client`. Everything else may be rearranged
from one version to the next.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

from somrs import cancellation
from somrs.version import __version__ as __version__

if TYPE_CHECKING:
    from somrs.api.system_client import Client
    from somrs.deployment.device import run
    from somrs.devices.passage import DoorDevice, LiftDevice
    from somrs.service_manager import Device, Refusal, ServiceFailed, Situation, Task, service
    from somrs.traffic.passage_call import PassageCall

__all__ = ["Client", "Device", "DoorDevice", "LiftDevice", "PassageCall", "Refusal", "ServiceFailed", "Situation", "Task", "run", "service"]

cancellation.repair()

_MODULES = {
    "Client": "somrs.api.system_client",
    "DoorDevice": "somrs.devices.passage",
    "LiftDevice": "somrs.devices.passage",
    "PassageCall": "somrs.traffic.passage_call",
    "run": "somrs.deployment.device",
}
"""Where the public names live; those that are not listed, in `somrs.service_manager`."""


def __getattr__(name: str) -> object:
    # Not imported before somebody asks: every program of a system imports this package, and few need all of it.
    if name in __all__:
        return getattr(importlib.import_module(_MODULES.get(name, "somrs.service_manager")), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
