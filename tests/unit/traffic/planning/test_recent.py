"""What was used last is not found again, and no more than that is kept."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from somrs.traffic.planning.recent import recall


@given(st.lists(st.integers(0, 6)), st.integers(1, 4))
def test_the_values_that_were_used_last_are_known(keys: list[int], most: int) -> None:
    values: dict[int, int] = {}
    searched: list[int] = []

    def square() -> int:
        searched.append(key)
        return key * key

    for number, key in enumerate(keys):
        recent_keys = [*dict.fromkeys(reversed(keys[:number]))][:most]
        searches = len(searched)
        assert recall(values, key, square, most) == key * key
        assert (len(searched) == searches) == (key in recent_keys)
        assert len(values) <= most
