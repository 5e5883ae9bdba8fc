"""What components whose inputs are kept say of their journals: by that these are found again, and gone on with."""

from __future__ import annotations

from somrs.registry.component import SCHEMA as REGISTRY
from somrs.repository.component import SCHEMA as REPOSITORY
from somrs.repository.component import only_reads
from somrs.service_manager.participant.participant import SCHEMA as SERVICE_MANAGER
from somrs.service_manager.sdk.orders import Failure, Perform, Report, ServiceFailed, Undo


def test_what_is_kept_and_how() -> None:
    assert [
        (schema.component, schema.version, schema.volatile, schema.relocatable, schema.irreplaceable, schema.snapshot_after)
        for schema in (REPOSITORY, REGISTRY, SERVICE_MANAGER)
    ] == [
        ("repository", 1, (), True, True, 500),
        ("registry", 4, (), False, False, 5000),
        ("service-manager", 2, (Perform, Undo, Report), True, False, 5000),
    ]
    assert REPOSITORY.is_read_only is only_reads
    assert SERVICE_MANAGER.error_to_answer(ServiceFailed("it broke", "A isOn B")) == Failure("it broke", "A isOn B")
