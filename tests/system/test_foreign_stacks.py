"""SOAP stacks of other makes take part, with certificates and without: zeep as a client, node-soap as a robot, gSOAP as both."""

from __future__ import annotations

import asyncio
import subprocess
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
import requests
import zeep
import zeep.exceptions

from somrs.client.client import Client
from somrs.deployment.system import System
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.trust.authority import Authority
from somrs.trust.enrolment import enrol
from somrs.trust.identity import Identity, Role
from tests.support import warm
from tests.support.foreign_programs import free_port, node_participant, running_participant
from tests.support.gsoap_programs import gsoap_programs
from tests.support.hang import HANG_TIME
from tests.support.paths import SCENARIO_1

UNKNOWN, GOAL = "Jar77 isOn Platform001", "Jar002 isOn Platform001"
SERVICE = {
    "Name": "TransferObject",
    "Effect": "?Object isOn ?Destination",
    "Precondition": "?Object isOn ?Source AND ?Destination.Supporting = TRUE",
    "Inputs": [{"Name": "Object", "Type": "Graspable"}, {"Name": "Destination", "Type": "Object"}],
}


class Enrolled:
    """The certificate of a program of another make, in a folder; without an authority, it has none."""

    def __init__(self, data: Path, folder: Path, name: str, role: Role) -> None:
        self.session = requests.Session()
        self.session.trust_env = False  # certificate authorities of the environment would take the place of the one below
        self.configuration: dict[str, object] = {"name": name}
        authority = Authority.of_data(data)
        if not authority.exists:
            return
        now = datetime.now(UTC)
        word = authority.invite(Identity(name=name, roles=frozenset({role})), now, hosts=("127.0.0.1",))
        enrol(authority, word, ("127.0.0.1",), folder, now)
        certificate, key, authority_file = (str(folder / file) for file in (f"{name}.pem", f"{name}.key", "authority.pem"))
        self.session.cert, self.session.verify = (certificate, key), authority_file
        self.configuration |= {"certificate": certificate, "key": key, "authority": authority_file}

    def files_of_gsoap(self) -> list[str]:
        """The files of its certificate as gSOAP reads them: the key and the certificate in one, and those of the authority."""
        if "certificate" not in self.configuration:
            return []
        key, certificate = (Path(str(self.configuration[kind])) for kind in ("key", "certificate"))
        together = certificate.with_suffix(".both.pem")
        together.write_text(key.read_text() + certificate.read_text())
        return [str(together), str(self.configuration["authority"])]

    def client(self, address: str) -> Any:
        """A client of zeep for the component at the address."""
        transport = zeep.Transport(session=self.session, timeout=HANG_TIME, operation_timeout=HANG_TIME)  # type: ignore[no-untyped-call]
        return zeep.Client(f"{address}?wsdl", transport=transport).service  # type: ignore[no-untyped-call]


def carry_with_node_and_zeep(system: System, device: str, folder: Path, cache: Path) -> list[str]:
    """Have a thing carried by a robot of node-soap, asked for by a client of zeep. What the robot has heard."""
    enrolled = Enrolled(system.data, folder, "NodeRobot", Role.DEVICE)
    description = folder / "participant.wsdl"
    description.write_text(enrolled.session.get(f"{device}?wsdl").text)
    own = {"port": free_port(), "registry": system.addresses.registry, "description": str(description), "service": SERVICE}
    with running_participant(node_participant(enrolled.configuration | own)) as participant:
        assert "Withheld" not in participant.published()
        manager = Enrolled(system.data, folder, "Zeep", Role.CLIENT).client(system.addresses.task_manager)
        with pytest.raises(zeep.exceptions.Fault, match="Jar77"):
            manager.Submit(Effect=UNKNOWN)
        task = manager.Submit(Effect=GOAL)
        news = manager.WatchTask(Task=task, Wait=10)
        while news.View.Phase != "ended":
            news = manager.WatchTask(Task=task, After=news.Events[-1].Number if news.Events else 0, Wait=5)
        assert news.View.Outcome == "accomplished", news
        return participant.heard_until("End")


def carry_with_gsoap(system: System, device: str, folder: Path, cache: Path) -> list[str]:
    """Have a thing carried by a robot of gSOAP, asked for by a client of gSOAP. What the robot has heard."""
    robot, client = (Enrolled(system.data, folder, f"Gsoap{kind}", role) for kind, role in (("Robot", Role.DEVICE), ("", Role.CLIENT)))
    addresses = {"registry": system.addresses.registry, "task-manager": system.addresses.task_manager, "participant": device}
    programs = gsoap_programs(cache, robot.session, addresses)
    robot_command = [programs.participant, "GsoapRobot", str(free_port()), system.addresses.registry, *robot.files_of_gsoap()]
    with running_participant(robot_command) as participant:
        assert "Withheld" not in participant.published()
        client_command = [programs.client, "Gsoap", system.addresses.task_manager, UNKNOWN, GOAL, *client.files_of_gsoap()]
        *problem, outcome = subprocess.run(
            client_command, check=True, stdout=subprocess.PIPE, text=True, timeout=HANG_TIME
        ).stdout.splitlines()
        assert "Jar77" in problem[0]
        assert outcome == "accomplished"
        return participant.heard_until("End")


@pytest.mark.parametrize(
    ("carry", "certificates"),
    [
        pytest.param(carry_with_node_and_zeep, True, id="node-soap and zeep-certificates"),
        pytest.param(carry_with_gsoap, False, id="gSOAP-plain"),
        pytest.param(carry_with_node_and_zeep, False, id="node-soap and zeep-plain", marks=pytest.mark.slow),
        pytest.param(carry_with_gsoap, True, id="gSOAP-certificates", marks=pytest.mark.slow),
    ],
)
def test_a_robot_and_a_client_of_other_makes_take_part(
    tmp_path: Path, pytestconfig: pytest.Config, certificates: bool, carry: Callable[[System, str, Path, Path], list[str]]
) -> None:
    cache = pytestconfig.cache
    assert cache is not None, "its plugin is on"

    async def run() -> None:
        system = System(
            [SCENARIO_1],
            tmp_path / "data",
            speed="max",
            world=WorldKind.KINEMATIC,
            windows=False,
            launcher=warm.launcher(),
            certificates=certificates,
        )
        async with system, Client(system.addresses) as client:
            device = next(offer.address for offer in await client.services())
            heard = await asyncio.to_thread(carry, system, device, tmp_path, cache.mkdir("gsoap"))
            assert heard == ["Arrange", "Accept", "Execute", "End"], "each message came once"
            if certificates:
                with pytest.raises(requests.exceptions.ConnectionError):
                    await asyncio.to_thread(requests.get, f"{device}?wsdl", verify=str(tmp_path / "authority.pem"), timeout=HANG_TIME)

    asyncio.run(run())
