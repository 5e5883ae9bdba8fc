"""The classes with which an author writes a device: `from somrs.service_manager import Device, service, Task`.

`somrs.deployment.device.run` runs a device.
"""

from somrs.service_manager.sdk.device import Device, Result, Situation, Task, service
from somrs.service_manager.sdk.orders import Refusal, ServiceFailed

__all__ = ["Device", "Refusal", "Result", "ServiceFailed", "Situation", "Task", "service"]
