"""The file of `--oidc`: mistakes in it, and which role somebody has for what the provider says."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from somrs.access.oidc_settings import OidcSettings, check_oidc, read_oidc_settings
from somrs.access.rights import PersonRole
from somrs.errors import UsageError

RIGHT = "issuer: https://login.example\nclient: somrs\nroles: {robots: operator}\n"


def test_a_file_is_read(tmp_path: Path) -> None:
    file = tmp_path / "oidc.yaml"
    file.write_text(f"{RIGHT}secret_file: client.secret\nhours: 1\n", encoding="utf-8")
    (tmp_path / "client.secret").write_text("hush\n", encoding="utf-8")
    settings = read_oidc_settings(file)
    assert (settings.name, settings.secret, settings.roles, settings.hours) == (
        "login.example",
        "hush",
        {"robots": PersonRole.OPERATOR},
        1.0,
    )


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "Expected `object`, got `null`"),
        ("issuer: https://login.example\n", "missing required field `client`; `issuer` is the provider's address"),
        (f"{RIGHT}role: viewer\n", "unknown field `role`"),
        (f"{RIGHT}everyone: king\n", "Invalid enum value 'king' - at `$.everyone`"),
        (f"{RIGHT}hours: 0\n", "Expected `float` > 0.0 - at `$.hours`"),
        (f"{RIGHT}secret: hush\n", "the secret has a file of its own"),
        (f"{RIGHT}secret_file: none.secret\n", "none.secret has to have the secret of the client, and cannot be read: No such file"),
        (f"{RIGHT}scopes: [profile]\n", "`openid` is missing"),
        (RIGHT.replace("https", "http"), "'http://login.example' has to begin with https://"),
        (RIGHT.replace("roles", "#"), "nobody has a role"),
        ("issuer: [", "oidc.yaml:"),
    ],
)
def test_mistakes_in_a_file(tmp_path: Path, text: str, problem: str) -> None:
    file = tmp_path / "oidc.yaml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(UsageError, match=re.escape(problem)):
        check_oidc(file, secure=True)


def test_a_system_in_which_nobody_signs_in_needs_no_provider(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="with --insecure nobody signs in"):
        check_oidc(tmp_path / "oidc.yaml", secure=False)


@pytest.mark.parametrize(
    ("claim", "claims", "role"),
    [
        ("groups", {"groups": ["admins", "robots"]}, PersonRole.ADMINISTRATOR),
        ("groups", {"groups": "robots"}, PersonRole.OPERATOR),
        ("groups", {"groups": ["staff"]}, None),
        ("groups", {"groups": [1, None, {}]}, None),
        ("groups", {"groups": {"robots": True}}, None),
        ("groups", {}, None),
        ("realm_access.roles", {"realm_access": {"roles": ["robots"]}}, PersonRole.OPERATOR),
        ("realm_access.roles", {"realm_access": "robots"}, None),
        ("https://site.example/roles", {"https://site.example/roles": ["robots"]}, PersonRole.OPERATOR),
    ],
)
def test_roles_for_claims(claim: str, claims: dict[str, Any], role: PersonRole | None) -> None:
    roles = {"robots": PersonRole.OPERATOR, "admins": PersonRole.ADMINISTRATOR}
    settings = OidcSettings(issuer="https://login.example", client="somrs", claim=claim, roles=roles)
    assert settings.role(claims) is role
    for_everyone = OidcSettings(issuer="https://login.example", client="somrs", claim=claim, roles=roles, everyone=PersonRole.VIEWER)
    assert for_everyone.role(claims) is (role or PersonRole.VIEWER)
