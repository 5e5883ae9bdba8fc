"""A running system of real processes, with methods to kill, repair and reset it between runs."""

from __future__ import annotations

import asyncio
import contextlib
import math
import shutil
import signal
import time
import uuid
from importlib import resources
from pathlib import Path

import msgspec

from somrs.client.client import Client
from somrs.client.credentials import credentials_for
from somrs.client.simulator_link import operator_link
from somrs.demo.hosts import made_authority
from somrs.deployment.launcher import Launcher
from somrs.deployment.private_files import discard
from somrs.deployment.system import System
from somrs.devices.simulator.link.commands import Fault
from somrs.errors import RemoteError, SomrsError
from somrs.ontology.files.loading import load
from somrs.ontology.map import Map
from somrs.ontology.types import Ontology
from somrs.protocol.messages import frp
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import ANONYMOUS, Header, Message
from somrs.protocol.messages.frp import State
from somrs.protocol.messages.knowledge import UpdateMap
from somrs.runtime.wire import Wire, retry_unanswered
from somrs.trust.credentials import FOLDER as TRUST
from somrs.trust.credentials import Credentials
from verification.kill_runs.bus import SITE, BusOfHosts
from verification.kill_runs.draw import HOMES, Victim
from verification.kill_runs.scenarios import DEVICES, PATROL, ROBOTS, THINGS

PATIENCE = 60.0
"""Seconds for which the client that judges a run asks again: a bus that has just lost a server may be long to store anything."""
FREE_TIME = 30.0
"""Seconds after the repair within which a device has to be able to begin a contract at once."""
ANSWERED = 10.0
"""Seconds within which the simulator has to say how the world is, for the record of a failed run."""
START_TOLERANCE = 2.0
"""The tolerance for a contract that begins at once, in seconds."""


class Trouble(Exception):
    """The system cannot be reset for a run, or a run cannot be ended."""


class RunningSystem:
    """One system in a folder. An asynchronous context manager."""

    system: System

    def __init__(self, data: Path, launcher: Launcher | None = None, *, is_on_bus: bool = False, is_planned: bool = False) -> None:
        self.data = data
        self._hosts: BusOfHosts | None = None
        self._is_on_bus, self._is_planned, self._launcher = is_on_bus, is_planned, launcher
        with resources.as_file(resources.files("somrs.demo") / "data" / "scenario-2.yaml") as site:
            self._site = site
            loaded = load([site])
        assert loaded.map is not None, "the site has a map"
        self.ontology: Ontology = loaded.ontology
        self._homes: Map = loaded.map
        self._open = contextlib.AsyncExitStack()

    async def __aenter__(self) -> RunningSystem:
        discard(self.data)
        try:
            folder = self.data / "rest" if self._is_on_bus else self.data
            if self._is_on_bus:
                hosts = BusOfHosts(self.data / "hosts", made_authority(folder, SITE))
                self._hosts = await self._open.enter_async_context(hosts)
            bus, name = (self._hosts.servers[SITE], SITE) if self._hosts is not None else (None, None)
            self.system = System(
                [self._site],
                folder,
                speed="max",
                launcher=self._launcher,
                devices_per_process=1,
                bus=bus,
                name=name,
            )
            await self._open.enter_async_context(self.system)
            if self._hosts is not None:
                await self._hosts.replace_components_of(self.system, self._site)
            client_wire = Wire(credentials_for(self.system.addresses))
            self._open.push_async_callback(client_wire.close)

            async def post(message: Message, timeout: float) -> Message | None:
                return await retry_unanswered(lambda: client_wire.post(message, timeout), PATIENCE)

            self.client = await self._open.enter_async_context(Client(self.system.addresses, post))
            self.operator = await self._open.enter_async_context(operator_link(self.system.addresses))
            # It speaks as the Task Manager does, to ask devices and to send them what is late.
            certificate = folder / TRUST / "programs" / "task-manager.pem"
            self._wire = Wire(Credentials(certificate))
            self._open.push_async_callback(self._wire.close)
        except BaseException:  # also an interrupt: no process may be left
            await self._open.aclose()
            raise
        return self

    async def __aexit__(self, *exception: object) -> None:
        for name in self.system.programs:
            self.signal(name, signal.SIGCONT)
        await self._open.aclose()

    @property
    def message_files(self) -> list[Path]:
        """The files with the messages of the Task Manager, one for each process that may be it."""
        return self._hosts.message_files if self._hosts is not None else [self.data / "messages.jsonl"]

    # Faults

    def signal(self, program: str, signal_number: signal.Signals) -> None:
        """Send a signal to a process, if it exists."""
        with contextlib.suppress(ProcessLookupError):
            self.system.programs[program].process.send_signal(signal_number)

    async def strike(self, victim: Victim, device: str) -> None:
        match victim:
            case Victim.LINK:
                await self.operator.fault(device, Fault.LINK)
            case Victim.DEVICE:
                self.signal(device, signal.SIGKILL)
            case Victim.HOST:
                assert self._hosts is not None, "hosts are victims on a bus only"
                if self._is_planned:
                    self._hosts.take_out_leader()
                else:
                    await self._hosts.kill_leader()
            case _:
                self.signal(victim, signal.SIGKILL)

    async def revive(self, victim: Victim, device: str) -> None:
        """Start the victim again, and return when it is ready."""
        if victim is Victim.LINK:
            await self.operator.repair(device, Fault.LINK)
        elif victim is Victim.HOST:
            assert self._hosts is not None, "hosts are victims on a bus only"
            await self._hosts.taken_over()
        else:
            await self.system.restart(device if victim is Victim.DEVICE else victim)

    async def send(self, address: str, transaction: str, participant: str, body: Body, *, sender: str = ANONYMOUS) -> Message | None:
        """Send a message to a participant, and return the answer on the same connection."""
        header = Header(
            sender=sender,
            recipient=address,
            message_id=uuid.uuid4().urn,
            reply_to=sender,
            transaction=transaction,
            participant=participant,
        )
        return await self._wire.post(Message(header=header, body=body), timeout=20.0)

    # Queries

    async def devices(self) -> dict[str, str]:
        """Return the addresses of the devices that offer services."""
        return {offer.provider: offer.address for offer in await self.client.services()}

    async def state(self, address: str, transaction: str, participant: str) -> State:
        """Return a participant's state from its Service Manager. Raises Trouble for another answer than a Status."""
        answer = await self.send(address, transaction, participant, frp.Query())
        if answer is None or not isinstance(answer.body, frp.Status):
            raise Trouble(f"{participant} answered a Query with {type(answer.body).__name__ if answer else 'nothing'}")
        return answer.body.state

    # Reset

    async def set_right(self) -> None:
        """Repair everything, put every thing to its initial place, and wait until all devices are registered and free."""
        await self.mend()
        if self._hosts is not None:
            await self._hosts.bring_back(self._site)
        for thing in THINGS:
            home = self._homes.objects[thing].values
            await self.operator.move(thing, *(float(home[f"Position{axis}"]) for axis in "XYZ"))
        await self.operator.idle()
        parts = []
        for thing in THINGS:
            thing_state = await self.operator.observe(thing)
            if thing_state.support != HOMES[thing]:
                raise Trouble(f"{thing} was put on {HOMES[thing]}, and is on {thing_state.support}")
            places = [
                f"{thing}.Position{axis} = {value:.3f}"
                for axis, value in zip("XYZ", (thing_state.x, thing_state.y, thing_state.z), strict=True)
            ]
            parts += [f"{thing} isOn {HOMES[thing]}", f"{thing}.Unknown = FALSE", *places]
        parts += [f"{device}.Working = TRUE" for device in DEVICES]
        for robot, state in (await self.operator.robots()).items():
            pose = {"PositionX": state.x, "PositionY": state.y, "RotationZ": math.remainder(state.yaw, math.tau)}
            parts += [f"{robot}.{path} = {value:.3f}" for path, value in pose.items()]
        await self.client.update(UpdateMap(situation=" AND ".join(parts), author="reset"))

    async def mend(self) -> None:
        for device in DEVICES:
            self.signal(device, signal.SIGCONT)
            for fault in Fault:
                await self.operator.repair(device, fault)

    async def all_free(self) -> None:
        """Raise Trouble unless every device is registered and gives terms for a contract that begins at once. The terms are cancelled."""
        loop = asyncio.get_running_loop()
        end, troubles = loop.time() + FREE_TIME, dict.fromkeys(DEVICES, "it is not in the Registry")
        while troubles and loop.time() < end:
            try:
                addresses = await self.devices()
            except RemoteError as error:
                troubles = dict.fromkeys(troubles, str(error))
                addresses = {}
            probes = {device: self._trouble(device, addresses[device]) for device in troubles if device in addresses}
            answers = await asyncio.gather(*probes.values())
            troubles |= dict(zip(probes, answers, strict=True))
            troubles = {device: trouble for device, trouble in troubles.items() if trouble}
            if troubles:
                await asyncio.sleep(0.1)
        if troubles:
            details = "; ".join(f"{device}: {trouble}" for device, trouble in troubles.items())
            raise Trouble(f"not free after {FREE_TIME:.0f} s: {details}")

    async def _trouble(self, device: str, address: str) -> str:
        """Return why the device would not begin a contract at once, or an empty string."""
        transaction, kind = uuid.uuid4().urn, "TransferObject" if device in ROBOTS else "RecognizeSituation"
        participant = f"{device}.{kind}#probe"
        inputs = {"Object": "Carton001", "Destination": "Platform001"} if device in ROBOTS else {"Object": "Carton001"}
        effect = "Carton001 isOn Platform001" if device in ROBOTS else "Carton001.Unknown = FALSE"
        try:
            answer = await self.send(address, transaction, participant, frp.Arrange(service_type=kind, inputs=inputs, effect=effect))
            await self.send(address, transaction, participant, frp.Cancel(reason="it was only asked"))
        except SomrsError as error:
            return str(error)
        match answer:
            case Message(body=frp.Terms(start_from=start)):
                late = (start or 0.0) - time.time()
                return f"it would begin in {late:.0f} s" if late > START_TOLERANCE else ""
            case Message(body=frp.Refuse(reason=reason)):
                return reason if device in (*ROBOTS, PATROL) else ""  # a camera refuses what it does not see
            case _:
                return f"it answered {type(answer.body).__name__ if answer else 'nothing'}"

    async def save_world(self, folder: Path) -> None:
        """Save what the simulator says of the world and of its traffic now: who waits for whom, on which ways, and what is closed."""
        operator = self.operator
        world: dict[str, object] = {}
        try:
            async with asyncio.timeout(ANSWERED):
                world["clock"] = await operator.clock()
                world["devices"] = await operator.devices()
                world["traffic"] = await operator.traffic()
                world["roadmap"] = await operator.roadmap()
                world["things"] = {thing: await operator.observe(thing) for thing in THINGS}
        except (SomrsError, TimeoutError) as error:
            world["unanswered"] = repr(error)
        (folder / "world.json").write_bytes(msgspec.json.format(msgspec.json.encode(world)))

    def save_logs(self, folder: Path) -> None:
        """Copy the logs and the messages of all hosts to the folder."""
        for pattern in ("*.log", "messages.jsonl"):
            for source in self.data.rglob(pattern):
                target = folder / source.relative_to(self.data)
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy(source, target)
