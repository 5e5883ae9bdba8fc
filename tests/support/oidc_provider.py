"""A real OpenID Connect provider, in a process of its own: npm's `oidc-provider`, which can also be made to answer wrongly."""

from __future__ import annotations

import json
import shutil
import subprocess
import urllib.request
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from tests.support.paths import ROOT

PROGRAM = ROOT / "tests" / "support" / "javascript" / "provider.js"
NOT_INSTALLED = "signing in at a provider, because npm's oidc-provider is not in node_modules; `make javascript` installs it"
OLD_NODE = "signing in at a provider, because npm's oidc-provider needs node 20 or newer"

CLIENT, SECRET = "somrs", "a secret: of 100 % tests"

PEOPLE: Mapping[str, Mapping[str, Any]] = {
    "ada": {"name": "Ada Lovelace", "preferred_username": "ada", "email": "ada@example.com", "groups": ["staff", "robot-engineers"]},
    "ada2": {"name": "Ada Lovelace", "preferred_username": "ada.2", "groups": ["robot-operators"]},
    "grace": {"name": "Grace", "groups": ["robot-operators", "robot-admins"]},
    "eve": {"name": "Eve", "groups": ["staff"]},
    "nameless": {"groups": ["robot-operators"]},
}
"""What the provider says of people, by what they enter as their login; every password is right."""

SETTINGS = """
issuer: {issuer}
client: somrs
secret_file: client.secret
label: Example Ltd
roles: {{robot-admins: administrator, robot-engineers: engineer, robot-operators: operator}}
"""


class RunningProvider:
    """A provider at `issuer`."""

    def __init__(self, issuer: str) -> None:
        self.issuer = issuer

    def answer_wrongly(self, fault: str) -> None:
        """Make its next tokens wrong in one of the ways of `provider.js`; none for an empty text."""
        self._control("fault", fault)

    def change_keys(self) -> None:
        """From now on, it signs with a key that it did not have before, and has no other."""
        self._control("keys")

    def change_people(self, people: Mapping[str, Mapping[str, Any]]) -> None:
        """From now on, it says this of people."""
        self._control("people", json.dumps(people))

    def send_back_to(self, *returns: str) -> None:
        """From now on, it sends browsers back to pages of these servers."""
        self._control("returns", json.dumps(returns))

    def _control(self, path: str, content: str = "") -> None:
        with urllib.request.urlopen(urllib.request.Request(f"{self.issuer}/test/{path}", content.encode(), method="PUT")):
            pass

    def write_settings(self, folder: Path, further: str = "") -> Path:
        """Write the file for `--oidc`, and that of the secret."""
        file = folder / "oidc.yaml"
        file.write_text(SETTINGS.format(issuer=self.issuer) + further, encoding="utf-8")
        (folder / "client.secret").write_text(f"{SECRET}\n", encoding="utf-8")
        return file


@contextmanager
def running_provider(*returns: str, people: Mapping[str, Mapping[str, Any]] = PEOPLE) -> Iterator[RunningProvider]:
    """Run a provider, which sends browsers back to pages of these servers. Skips the test if it is not installed."""
    node = shutil.which("node")
    if node is None or not (ROOT / "node_modules" / "oidc-provider").exists():
        pytest.skip(NOT_INSTALLED)
    if int(subprocess.run([node, "--version"], capture_output=True, text=True, check=True).stdout.lstrip("v").split(".")[0]) < 20:
        pytest.skip(OLD_NODE)
    settings = json.dumps({"client": CLIENT, "secret": SECRET, "returns": returns, "people": people})
    process = subprocess.Popen([node, str(PROGRAM), settings], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    try:
        assert process.stdout is not None
        issuer = process.stdout.readline().strip()
        assert issuer.startswith("http"), "the provider has not started"
        yield RunningProvider(issuer)
    finally:
        process.kill()
        process.communicate()
