"""The tokens with which a gateway passes on messages of a neighbour's programs on a bus."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.errors import UsageError
from somrs.runtime.bus_address import token_of
from somrs.runtime.bus_rights import neighbour_of, permissions, token_of_sender
from somrs.trust.identity import Identity, Role

names = st.text(min_size=1, max_size=12) | st.sampled_from(["Barn:Robot", "a+b", "a.b", "*", ">", "Ärger"])
roles = st.frozensets(st.sampled_from(Role), min_size=1)


@given(names, names, roles, st.frozensets(names, max_size=3))
def test_a_token_says_all_that_the_gateway_has_proven(site: str, name: str, held: frozenset[Role], speaks_for: frozenset[str]) -> None:
    identity = Identity(name=name, roles=held, speaks_for=speaks_for, site=site)
    token = token_of_sender(identity)
    assert neighbour_of(token) == identity
    assert not {*token} & {*".*> "}, "it is one token of a subject"


@given(names, names, names)
def test_no_own_program_has_such_a_token(name: str, site: str, neighbour: str) -> None:
    own = token_of_sender(Identity(name=name, roles=frozenset({Role.DEVICE})))
    assert own == token_of(name)
    assert ":" not in own
    assert own != token_of_sender(Identity(name=neighbour, roles=frozenset({Role.DEVICE}), site=site))


def test_only_a_gateway_may_use_other_tokens_than_its_own() -> None:
    for role in Role:
        if role is Role.BUS:
            continue
        published = permissions(Identity(name="Barn:Robot", roles=frozenset({role})))["publish"]
        assert isinstance(published, list)
        senders = {subject.split(".")[2] for subject in published if subject.startswith("somrs-from.")}
        assert senders == ({"*"} if role is Role.GATEWAY else {"Barn%3ARobot"})


@pytest.mark.parametrize("token", ["Barn:", "Barn:a:b", "Barn:a:b:c:d", "Barn:repository:king:"])
def test_a_broken_token_is_nobody_s(token: str) -> None:
    with pytest.raises((UsageError, ValueError)):
        neighbour_of(token)
