"""Effects that a service of a kind cannot have."""

from __future__ import annotations

import pytest

from somrs.errors import DeviceError
from somrs.ontology.consistency import ontology_violations
from somrs.ontology.files.loading import upper
from somrs.ontology.service_kinds import kind_problems, planning_notes
from somrs.ontology.services import Parameter, ServiceKind, ServiceType
from somrs.service_manager.sdk.device import Device, Situation, Task, service

INPUTS = (Parameter(name="Object", type="Graspable"),)
OUTPUTS = (Parameter(name="Weight", type="number"), Parameter(name="Place", type="Support"))


def make(kind: ServiceKind, effect: str) -> ServiceType:
    return ServiceType(name="Serve", kind=kind, inputs=INPUTS, outputs=OUTPUTS, effect=effect)


@pytest.mark.parametrize(
    ("kind", "effect", "problem"),
    [
        (ServiceKind.SOFTWARE, "?Object isOn Table1", "names no output"),
        (ServiceKind.SOFTWARE, "?Object isOn ?Place AND ?Object.Color = Red", "`?Object.Color = Red` names no output"),
        (ServiceKind.SOFTWARE, "?Object isOn ?Place", None),
        (ServiceKind.COGNITIVE, "?Object.Weight = ?Weight", None),
        (ServiceKind.COGNITIVE, "?Object isOn Table1 OR ?Object isOn Table2", None),
        (ServiceKind.COGNITIVE, "?Object.Weight = ?Object.Weight - 1", "a new value that depends on the present one"),
        (ServiceKind.COGNITIVE, "?Object.Weight - 1 = ?Object.Weight", "a new value that depends on the present one"),
        (ServiceKind.PHYSICAL, "?Object.Weight = ?Object.Weight - 1", None),
        (ServiceKind.SOFTWARE, "no formula at all", None),
    ],
)
def test_what_an_effect_can_say_depends_on_the_kind(kind: ServiceKind, effect: str, problem: str | None) -> None:
    problems = [*kind_problems(make(kind, effect))]
    assert (problem is not None) == bool(problems)
    assert problem is None or problem in problems[0]


def test_the_ontology_is_not_consistent_with_such_a_service() -> None:
    (violation,) = ontology_violations(upper().extended([make(ServiceKind.SOFTWARE, "?Object.Color = Red")]))
    assert (violation.subject, violation.rule, violation.path) == ("Serve", "kind", "effect")


def test_a_device_that_brings_such_a_service_type_does_not_start() -> None:
    class Painter(Device):
        type = "StationaryDevice"

        @service(make(ServiceKind.SOFTWARE, "?Object.Color = Red"), duration="1 s")
        async def paint(self, task: Task) -> Situation:
            return None

    with pytest.raises(DeviceError, match="Painter brings the service type Serve: a software service changes nothing"):
        Painter("P1").profile()


@pytest.mark.parametrize(
    ("precondition", "effect", "notes"),
    [
        ("?Object.Label = ?Text", "?Place isFreeFor ?Object AND ?Object.Weight = ?Weight", []),
        ("?Object.Label = ?Text", "?Place isFreeFor ?Object", ["the output ?Weight"]),
        (None, "?Place isFreeFor ?Object AND ?Object.Weight = ?Weight", ["its input ?Text"]),
        (None, "?Object.Label = ?Text", ["the output ?Weight", "the output ?Place"]),
        ("not Entish", "(", ["the output ?Weight", "the output ?Place", "its input ?Text"]),
    ],
)
def test_what_no_plan_can_use_is_noted(precondition: str | None, effect: str, notes: list[str]) -> None:
    inputs = (*INPUTS, Parameter(name="Text", type="text"))
    service_type = ServiceType(name="Serve", inputs=inputs, outputs=OUTPUTS, precondition=precondition, effect=effect)
    texts = [*planning_notes(service_type)]
    assert len(texts) == len(notes)
    for text, note in zip(texts, notes, strict=True):
        assert note in text


def test_the_shipped_service_types_can_all_be_used_in_plans() -> None:
    assert [text for service_type in upper().services.values() for text in planning_notes(service_type)] == []
