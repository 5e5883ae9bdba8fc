"""The store of who has access."""

from __future__ import annotations

import itertools
import stat
import time
from pathlib import Path

import pytest

from somrs.access.rights import PersonRole, Right
from somrs.access.state import LINK_TIME, MAX_NAME, MAX_SESSIONS, hash_of
from somrs.access.store import FILE, LOCAL_FILE, AccessStore, local_token
from somrs.errors import UsageError


def test_each_role_has_the_rights_of_those_before_it() -> None:
    roles = [*PersonRole]
    assert all(lower.rights < higher.rights for lower, higher in itertools.pairwise(roles))
    assert all(Right.STOP in role.rights for role in roles), "nobody may be without it in an emergency"
    assert PersonRole.ADMINISTRATOR.rights == frozenset(Right)


def test_no_secret_is_in_the_file_and_nobody_else_reads_it(tmp_path: Path) -> None:
    store = AccessStore(tmp_path)
    secrets = [store.add_link(None), store.add_token("Program", frozenset({Right.SEE}), 60.0)]
    secrets.append(store.use_link(secrets[0], "Ada"))
    store.renew_local_token()
    content = (tmp_path / FILE).read_text()
    assert not any(secret in content for secret in secrets)
    assert all(stat.S_IMODE((tmp_path / name).stat().st_mode) == 0o600 for name in (FILE, LOCAL_FILE))
    for secret in secrets[1:]:
        identity = AccessStore(tmp_path).identity(secret)
        assert identity is not None
        assert not identity.speaks_for_others


def test_a_link_works_once_and_a_wrong_name_does_not_use_it_up(tmp_path: Path) -> None:
    store = AccessStore(tmp_path)
    link = store.add_link(None)
    with pytest.raises(UsageError, match="is not a name"):
        store.use_link(link, "  ")
    session = store.use_link(link, "  Ada   Lovelace ")
    identity = store.identity(session)
    assert identity is not None
    assert (identity.name, identity.rights) == ("Ada Lovelace", frozenset(Right))
    with pytest.raises(UsageError, match="was used"):
        store.use_link(link, "Mallory")
    later_link = store.add_link("Ada Lovelace")
    assert store.use_link(later_link) != session


def test_names_are_those_of_one_person_or_program(tmp_path: Path) -> None:
    store = AccessStore(tmp_path)
    store.add_account("Ada", PersonRole.VIEWER)
    with pytest.raises(UsageError, match="already"):
        store.add_account("ada", PersonRole.ADMINISTRATOR)
    with pytest.raises(UsageError, match="already"):
        store.add_token("ADA", frozenset(Right), 60.0)
    with pytest.raises(UsageError, match="there is no Grace; the people are: Ada"):
        store.set_role("Grace", PersonRole.VIEWER)
    store.add_account("x" * MAX_NAME, PersonRole.VIEWER)
    with pytest.raises(UsageError, match=f"a name has 1 to {MAX_NAME} printable characters"):
        store.add_account("x" * (MAX_NAME + 1), PersonRole.VIEWER)


def test_the_last_administrator_stays(tmp_path: Path) -> None:
    store = AccessStore(tmp_path)
    store.add_account("Ada", PersonRole.ADMINISTRATOR)
    store.add_account("Grace", PersonRole.OPERATOR)
    store.remove_account("Grace")
    with pytest.raises(UsageError, match="the last administrator"):
        store.remove_account("Ada")
    with pytest.raises(UsageError, match="the last administrator"):
        store.set_role("Ada", PersonRole.ENGINEER)


def test_a_new_password_ends_the_other_sessions(tmp_path: Path) -> None:
    store = AccessStore(tmp_path)
    store.add_account("Ada", PersonRole.ADMINISTRATOR)
    own, other, link = store.open_session("Ada"), store.open_session("Ada"), store.add_link("Ada")
    identity = store.identity(own)
    assert identity is not None
    store.set_password("Ada", "hash", kept_session=identity.session)
    assert store.identity(own) is not None
    assert store.identity(other) is None
    assert store.link(link) is None


def test_links_end(tmp_path: Path) -> None:
    store = AccessStore(tmp_path)
    secret = store.add_link(None)
    state, now = store.read(), time.time()
    assert hash_of(secret) in state.without_ended(now + LINK_TIME - 60.0).links
    assert not state.without_ended(now + LINK_TIME + 60.0).links


def test_sessions_are_bounded(tmp_path: Path) -> None:
    store = AccessStore(tmp_path)
    store.add_account("Ada", PersonRole.ADMINISTRATOR)
    sessions = [store.open_session("Ada") for _ in range(MAX_SESSIONS + 1)]
    assert store.identity(sessions[0]) is None
    assert all(store.identity(session) is not None for session in sessions[1:])


def test_a_new_start_makes_earlier_tokens_of_this_computer_worthless(tmp_path: Path) -> None:
    store = AccessStore(tmp_path)
    assert local_token(tmp_path) is None
    store.ensure_local_token()
    earlier_token = local_token(tmp_path) or ""
    assert store.identity(earlier_token) is not None
    store.ensure_local_token()
    assert store.identity(earlier_token) is not None
    store.renew_local_token()
    assert store.identity(earlier_token) is None


def test_a_file_that_cannot_be_read_lets_nobody_in(tmp_path: Path) -> None:
    (tmp_path / FILE).write_text("{")
    with pytest.raises(UsageError, match="cannot be read"):
        AccessStore(tmp_path).identity("x")
