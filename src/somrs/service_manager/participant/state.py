"""The state of a Service Manager, as one tree of data."""

from __future__ import annotations

from msgspec import Struct, field

from somrs.service_manager.participant.job import Job, Jobs, Key
from somrs.service_manager.participant.joining import Joining
from somrs.service_manager.participant.map_reports import MapReports
from somrs.service_manager.sdk.orders import Profile


class DeviceQueue(Struct):
    """The participants that wait for the device, in the order of their orders, and those whose work is under way."""

    waiting: list[Key] = []
    at_work: list[Key] = []


class ServiceManagerState(Struct, kw_only=True):
    joining: Joining
    jobs: Jobs = field(default_factory=Jobs)
    queue: DeviceQueue = field(default_factory=DeviceQueue)
    reports: MapReports = field(default_factory=MapReports)
    leaving: bool = False

    @classmethod
    def new(cls, profile: Profile, repository: str, registry: str) -> ServiceManagerState:
        return cls(joining=Joining(profile=profile, repository=repository, registry=registry))

    @property
    def profile(self) -> Profile:
        return self.joining.profile

    def occupies(self, job: Job) -> bool:
        """Whether the job takes up some of the device's capacity."""
        method = job.order.method if job.order is not None else None
        return all(capability.occupies for capability in self.profile.capabilities if capability.method == method)

    def waiting(self) -> list[Job]:
        """Return the participants that wait for the device."""
        return [job for key in self.queue.waiting if (job := self.jobs.find_job(*key)) is not None]
