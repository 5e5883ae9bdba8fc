"""Makes the components of a run."""

from __future__ import annotations

from somrs.runtime.virtual_time import World
from somrs.service_manager.participant.state import ServiceManagerState
from somrs.service_manager.sdk.orders import Capability, Profile
from somrs.task_manager.manager import TaskManager
from verification.fault_runs.scenario import DeviceTraits, Undo
from verification.fault_runs.simulated_device import DeviceManager, InputObserver, SimulatedDevice
from verification.fault_runs.site import service_type


class ComponentFactory:
    """Makes the components of a run. Tests override it to introduce defects."""

    def task_manager(self, address: str, repository: str, registry: str) -> TaskManager:
        return TaskManager(address, repository=repository, registry=registry)

    device_manager = DeviceManager

    def service_manager(
        self, profile: Profile, repository: str, registry: str, simulated_device: SimulatedDevice, observe_input: InputObserver
    ) -> DeviceManager:
        return self.device_manager(profile, repository=repository, registry=registry).attach(simulated_device, observe_input)

    def restore_service_manager(
        self, state: ServiceManagerState, simulated_device: SimulatedDevice, observe_input: InputObserver
    ) -> DeviceManager:
        return self.device_manager.restored(state).attach(simulated_device, observe_input)

    def revive(self, world: World, address: str) -> None:
        world.revive(address)


def profile(traits: DeviceTraits) -> Profile:
    """Return the device's profile for its Service Manager."""
    undoable = traits.undo is not Undo.IMPOSSIBLE
    capabilities = tuple(Capability(type=service_type(name), method=name, stoppable=True, undoable=undoable) for name in traits.services)
    return Profile(name=traits.name, type="PioneerP3DX", capabilities=capabilities, valid_for=traits.valid_for, lease=traits.lease)
