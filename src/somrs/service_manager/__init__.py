"""What device authors need: `from somrs.service_manager import Device, service, Task`; `somrs.app.device.run` runs it."""

from somrs.service_manager.device import Device, Result, Situation, Task, service
from somrs.service_manager.orders import Refusal, ServiceFailed

__all__ = ["Device", "Refusal", "Result", "ServiceFailed", "Situation", "Task", "service"]
