"""Limits come from the environment, and the reference lists all of them."""

from __future__ import annotations

import msgspec
import pytest

from somrs.errors import UsageError
from somrs.limits import PREFIX, Limits, limits
from tests.support.paths import ROOT


def test_limits_are_set_by_variables() -> None:
    assert limits({}) == Limits()
    assert limits({f"{PREFIX}CONNECTIONS": "7", "SOMRS_DATA": "x"}) == Limits(connections=7)


@pytest.mark.parametrize(
    ("name", "text"),
    [("CONNECTIONS", "-1"), ("CONNECTIONS", "0"), ("CONNECTIONS", "many"), ("CONNECTIONS", "1e308"), ("CONECTIONS", "1"), ("", "1")],
)
def test_what_sets_no_limit_is_an_error(name: str, text: str) -> None:
    with pytest.raises(UsageError, match=f"^{PREFIX}{name}={text} sets no limit: .*{PREFIX}CONNECTIONS"):
        limits({f"{PREFIX}{name}": text})


def test_the_reference_lists_all_limits_with_their_defaults() -> None:
    lines = (ROOT / "docs/reference/limits.md").read_text(encoding="utf-8").splitlines()
    rows = {tuple(cell.strip() for cell in line.split("|")[1:3]) for line in lines if line.startswith(f"| `{PREFIX}")}
    assert rows == {(f"`{PREFIX}{name.upper()}`", str(value)) for name, value in msgspec.structs.asdict(Limits()).items()}
