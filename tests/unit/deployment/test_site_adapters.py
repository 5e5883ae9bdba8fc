"""Where the broker is that is started for the adapters of a site."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from pathlib import Path

import pytest

from somrs.deployment.adapters import AdapterSettings
from somrs.deployment.site_adapters import SiteAdapters
from somrs.errors import ModelError, UsageError
from somrs.ontology.files.loading import upper
from somrs.ontology.map import Map
from somrs.trust.authority import Authority
from somrs.trust.credentials import Credentials
from somrs.trust.identity import Identity, Role
from tests.support.free_ports import free_port

HOST = "127.0.0.1"


def broker(folder: Path, *settings: str) -> str:
    """The address of the broker, for adapters that have these settings of theirs."""
    names = ("things", "vda5050")
    (folder / "site.yaml").write_text(
        "adapters:\n" + "".join(f"  {name}: {{broker: {setting}}}\n" for name, setting in zip(names, settings, strict=False))
    )
    adapters = SiteAdapters([folder / "site.yaml"], folder, HOST, {}, with_arcos=False)
    try:
        adapters.check(is_fresh=False)
        adapters.prepare(Map(), upper(), None)
        return adapters.broker
    finally:
        adapters.close()


def test_the_broker_is_where_the_site_says(tmp_path: Path) -> None:
    assert broker(tmp_path, "own 0.0.0.0:1883") == "mqtt://0.0.0.0:1883"
    assert broker(tmp_path, "own", "own 10.0.0.5:1883") == "mqtt://10.0.0.5:1883"
    assert broker(tmp_path, "mqtt://10.0.0.5") == ""


def test_a_broker_without_an_address_stays_where_it_was(tmp_path: Path) -> None:
    port = free_port()
    (tmp_path / "broker").mkdir()
    (tmp_path / "broker" / "server.conf").write_text(json.dumps({"mqtt": {"host": HOST, "port": port}}))
    assert broker(tmp_path, "own") == f"mqtt://{HOST}:{port}"


def test_there_is_one_broker(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=r"another adapter has it at 10\.0\.0\.5:1883"):
        broker(tmp_path, "own 10.0.0.5:1883", "own 10.0.0.6:1883")
    with pytest.raises(ModelError, match="'1883' is no address"):
        broker(tmp_path, "own 1883")


def test_the_broker_of_the_bus_is_used_with_the_certificate_of_the_program(tmp_path: Path) -> None:
    authority = Authority.of_data(tmp_path)
    authority.create("yard", datetime.now(UTC))
    identity = Identity(name="things", roles=frozenset({Role.DEVICE}), topics=frozenset({"#"}))
    certificate, key = authority.issue_program(identity, ("127.0.0.1",), datetime.now(UTC))
    entry = AdapterSettings("things", {"broker": "bus"}, str(tmp_path))
    assert entry.at_bus("mqtts://127.0.0.1:8883", Credentials(certificate)).settings == {
        "broker": "mqtts://127.0.0.1:8883",
        "certificates": {"authority": str(authority.certificate_file), "certificate": str(certificate), "key": str(key)},
    }
    other = AdapterSettings("things", {"broker": "mqtt://10.0.0.5"}, str(tmp_path))
    assert other.at_bus("mqtts://127.0.0.1:8883", Credentials(certificate)) == other.at_bus(None) == other
    with pytest.raises(UsageError, match="adapters: things: broker: bus: there is no bus that is known to speak MQTT"):
        entry.at_bus(None)
