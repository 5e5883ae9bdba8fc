"""Procedures for failures as people write them at the command line."""

from __future__ import annotations

import pytest

from somrs.cli.procedures import handler
from somrs.cli.task_commands import handlers
from somrs.errors import FormulaError
from somrs.ontology.services import Handler, Occasion
from tests.support.virtual_system import Robot, VirtualSystem

FAILURE = Occasion.FAILURE


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("?Object isOn Cupboard001", Handler(on=FAILURE, effect="?Object isOn Cupboard001")),
        (
            "TransferObject: ?Object isOn Cupboard001 WHEN ?Object isOn Floor001",
            Handler(on=FAILURE, service_type="TransferObject", effect="?Object isOn Cupboard001", when="?Object isOn Floor001"),
        ),
        ("?Object isOn ?Place: Shelf", Handler(on=FAILURE, effect="?Object isOn ?Place: Shelf")),
        ("Move-It:?A isOn B", Handler(on=FAILURE, service_type="Move-It", effect="?A isOn B")),
        ('?X.Label = "so WHEN not"', Handler(on=FAILURE, effect='?X.Label = "so WHEN not"')),
        ("A isOn WHENEVER", Handler(on=FAILURE, effect="A isOn WHENEVER")),
        (
            "FORALL ?Jar: Jar (NOT ?Jar isOn Floor001) WHEN EXISTS ?Jar: Jar (?Jar isOn Floor001)",
            Handler(on=FAILURE, effect="FORALL ?Jar: Jar (NOT ?Jar isOn Floor001)", when="EXISTS ?Jar: Jar (?Jar isOn Floor001)"),
        ),
        (
            "TransferObject: NOT (A isOn B OR C isOn B)",
            Handler(on=FAILURE, service_type="TransferObject", effect="NOT (A isOn B OR C isOn B)"),
        ),
    ],
)
def test_what_can_be_said(text: str, expected: Handler) -> None:
    assert handler(FAILURE, text) == expected


@pytest.mark.parametrize(
    ("text", "column"),
    [
        ("TransferObject: ?Object isOn", len("TransferObject: ?Object isOn")),
        ("TransferObject: ?Object isOn ) WHEN A isOn B", len("TransferObject: ?Object isOn ")),
        ("A isOn B WHEN C isOn", len("A isOn B WHEN C isOn")),
        ("A isOn B WHEN C isOn D WHEN E isOn F", len("A isOn B WHEN C isOn D ")),
        ("A isOn B WHEN", len("A isOn B WHEN")),
    ],
)
def test_the_caret_is_under_the_mistake_in_all_that_was_written(text: str, column: int) -> None:
    with pytest.raises(FormulaError) as caught:
        handler(FAILURE, text)
    problem, line, caret, *_ = str(caught.value).splitlines()
    assert problem
    assert line == f"  {text}"
    assert caret == f"  {' ' * column}^"


def test_the_option_is_named() -> None:
    with pytest.raises(FormulaError, match="--on-compensation"):
        handlers(["A isOn B"], ["A isOn"])
    procedures = handlers(["A isOn B"], ["C isOn D"])
    assert [procedure.on for procedure in procedures] == [Occasion.FAILURE, Occasion.COMPENSATION]


def test_a_procedure_for_a_service_type_that_nobody_knows_is_rejected_with_a_hint() -> None:
    """It would never be called for, and nobody would notice."""
    system = VirtualSystem(Robot("Robot1", 1, 10))
    problem = system.rejected("Jar002 isOn Platform001", handlers=(handler(FAILURE, "TransferObjekt: ?Object isOn Cupboard001"),))
    assert "TransferObjekt" in problem
    assert "did you mean TransferObject" in problem
