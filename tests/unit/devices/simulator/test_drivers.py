"""The drivers of the simulated devices and the service types of the upper ontology go together."""

from __future__ import annotations

import pytest

from somrs.deployment.device import load
from somrs.ontology.files.loading import upper

DRIVERS = sorted({type.driver for type in upper().types.values() if type.driver is not None and ".simulator." in type.driver})


@pytest.mark.parametrize("driver", DRIVERS)
def test_a_driver_reads_the_inputs_of_its_service_types(driver: str) -> None:
    services = load(driver)("Device1").services().values()
    assert services
    for service in services:
        capability = service.capability({})
        assert capability.inputs is not None, f"{service.name} does not name its inputs, so that no site could name them otherwise"
        assert capability.serves(upper().services[capability.type_name]), service.name
