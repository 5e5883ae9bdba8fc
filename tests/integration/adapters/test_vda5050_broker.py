"""Fleet control and simulated vehicles at a real broker."""

from __future__ import annotations

import asyncio
import contextlib
import subprocess
import sys
from collections.abc import AsyncIterator, Iterator
from datetime import UTC, datetime, timedelta
from ipaddress import ip_address
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat
from cryptography.x509.oid import NameOID

from somrs.adapters.vda5050.control.exchange import Passed, Reachable
from somrs.adapters.vda5050.messages.header import Version
from somrs.adapters.vda5050.mqtt import PASSWORD, Certificates, broker_address
from somrs.adapters.vda5050.simulated.body import StandInBody
from somrs.adapters.vda5050.simulated.factsheet import factsheet
from somrs.adapters.vda5050.simulated.program import MqttVehicle, address_of
from somrs.adapters.vda5050.simulated.vehicle import SimulatedVehicle
from tests.support.mqtt_broker import MqttBroker
from tests.support.vda5050_fleet import fleet_control, wait_until


@pytest.fixture
def broker(tmp_path: Path) -> Iterator[MqttBroker]:
    with MqttBroker(tmp_path) as server:
        yield server


@contextlib.asynccontextmanager
async def vehicle(broker: MqttBroker, name: str, version: Version, *, handles: bool = True) -> AsyncIterator[MqttVehicle]:
    address = broker_address(broker.url, Certificates(), Path())
    simulated = SimulatedVehicle(version, factsheet(handles=handles), map_id="hall")
    running = MqttVehicle(address_of(name, version, "acme"), simulated, StandInBody(), address)
    task = asyncio.create_task(running.run())
    try:
        yield running
    finally:
        task.cancel()
        await asyncio.wait({task})


def test_vehicles_of_both_versions_are_discovered_and_driven(broker: MqttBroker) -> None:
    async def test() -> None:
        settings = {"broker": broker.url, "vehicles": {"Forklift1": {"manufacturer": "acme", "serialNumber": "0001"}}}
        async with (
            fleet_control(settings) as fleet,
            vehicle(broker, "0001", Version.V2_1),
            vehicle(broker, "0002", Version.V3_0, handles=False) as second,
        ):
            await wait_until(lambda: set(fleet.devices) == {"Forklift1", "Acme0002"})
            assert set(fleet.devices["Forklift1"].services()) == {"move_to", "charge", "transfer"}
            assert set(fleet.devices["Acme0002"].services()) == {"move_to", "charge"}
            assert fleet.devices["Acme0002"].values["Speed"] == 1.0
            fleet.drive("Forklift1", "A", "B", spacing=0.5)
            fleet.drive("Acme0002", "A", "B", "C", spacing=0.5)
            await wait_until(lambda: fleet.has("Forklift1", Passed(number=1)) and fleet.has("Acme0002", Passed(number=2)))
            assert second.body.sense(0.0).x == 1.0

    asyncio.run(test())


def test_fleet_control_goes_on_at_the_next_server_of_its_broker(broker: MqttBroker, tmp_path: Path) -> None:
    async def test() -> None:
        (tmp_path / "next").mkdir()
        with MqttBroker(tmp_path / "next") as next_server:
            async with fleet_control({"broker": f"{broker.url},{next_server.url}"}) as fleet, vehicle(next_server, "0001", Version.V2_1):
                broker.kill()
                await wait_until(lambda: "Acme0001" in fleet.devices)

    asyncio.run(test())


def test_a_vehicle_that_takes_its_leave_is_not_reachable_any_more(broker: MqttBroker) -> None:
    async def test() -> None:
        async with fleet_control({"broker": broker.url}) as fleet:
            async with vehicle(broker, "0001", Version.V2_1):
                await wait_until(lambda: "Acme0001" in fleet.devices)
            await wait_until(lambda: fleet.has("Acme0001", Reachable(is_connected=False)))
            async with vehicle(broker, "0001", Version.V2_1):
                await wait_until(lambda: fleet.has("Acme0001", Reachable(is_connected=True)))

    asyncio.run(test())


def test_the_broker_says_that_a_vehicle_was_cut_off(broker: MqttBroker) -> None:
    async def test() -> None:
        command = [sys.executable, "-m", "somrs.adapters.vda5050.simulated", "0001", "--broker", broker.url]
        async with fleet_control({"broker": broker.url}) as fleet:
            process = subprocess.Popen(command)
            try:
                await wait_until(lambda: "SOMRS0001" in fleet.devices)
            finally:
                process.kill()
                process.wait()
            await wait_until(lambda: fleet.has("SOMRS0001", Reachable(is_connected=False)))

    asyncio.run(test())


def test_all_goes_on_when_the_broker_is_back(broker: MqttBroker) -> None:
    async def test() -> None:
        async with fleet_control({"broker": broker.url}) as fleet, vehicle(broker, "0001", Version.V3_0):
            await wait_until(lambda: "Acme0001" in fleet.devices)
            broker.kill()
            await wait_until(lambda: fleet.has("Acme0001", Reachable(is_connected=False)))
            fleet.drive("Acme0001", "A", "B", spacing=0.5)
            broker.start()
            await wait_until(lambda: fleet.has("Acme0001", Passed(number=1)))

    asyncio.run(test())


def test_fleet_control_waits_for_a_broker_that_is_not_there_yet(broker: MqttBroker) -> None:
    async def test() -> None:
        broker.kill()
        async with fleet_control({"broker": broker.url}) as fleet, vehicle(broker, "0001", Version.V2_1):
            await asyncio.sleep(0.3)
            broker.start()
            await wait_until(lambda: "Acme0001" in fleet.devices)

    asyncio.run(test())


def own_certificate(folder: Path) -> tuple[Path, Path]:
    """A certificate for 127.0.0.1 that has signed itself, and its key."""
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "broker")])
    now = datetime.now(UTC)
    certificate = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(name)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - timedelta(days=1))
        .not_valid_after(now + timedelta(days=1))
        .add_extension(x509.SubjectAlternativeName([x509.IPAddress(ip_address("127.0.0.1"))]), critical=False)
        .add_extension(x509.BasicConstraints(ca=True, path_length=None), critical=True)
        .sign(key, hashes.SHA256())
    )
    files = folder / "broker.pem", folder / "broker.key"
    files[0].write_bytes(certificate.public_bytes(Encoding.PEM))
    files[1].write_bytes(key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()))
    return files


def test_a_broker_with_certificates_and_passwords(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    certificate, key = own_certificate(tmp_path)

    async def test(broker: MqttBroker) -> None:
        url = f"mqtts://fleet@127.0.0.1:{broker.mqtt_port}"
        settings = {"broker": url, "certificates": {"authority": str(certificate)}}
        async with fleet_control(settings):
            await wait_until(lambda: "the broker is waited for" in caplog.text)
        monkeypatch.setenv(PASSWORD, "secret")
        address = broker_address(url, Certificates(authority=str(certificate)), Path())
        simulated = SimulatedVehicle(Version.V2_1, factsheet(), map_id="hall")
        running = MqttVehicle(address_of("0001", Version.V2_1, "acme"), simulated, StandInBody(), address)
        async with fleet_control(settings) as fleet:
            task = asyncio.create_task(running.run())
            try:
                await wait_until(lambda: "Acme0001" in fleet.devices)
            finally:
                task.cancel()
                await asyncio.wait({task})

    with MqttBroker(tmp_path, {"fleet": "secret"}, certificate, key) as broker:
        asyncio.run(test(broker))
