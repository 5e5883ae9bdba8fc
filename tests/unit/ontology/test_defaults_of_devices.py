"""What devices are if nobody has said otherwise."""

from __future__ import annotations

import pytest

from somrs.ontology.files.loading import upper
from somrs.ontology.types import IN_SERVICE


@pytest.mark.parametrize("kind", ["MobileRobot", "Lift", "AutomaticDoor", "Person"])
def test_devices_are_in_service_unless_somebody_takes_them_out(kind: str) -> None:
    """Seen: the map page drew them as out of service by default."""
    assert upper().default(kind, IN_SERVICE) is True
