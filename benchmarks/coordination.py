"""Measures coordination: one coordinator contracts one of ten bidders, durably, in SO-MRS and in other systems.

`python benchmarks/coordination.py` measures all of them in turns, or those that its arguments name.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from importlib import import_module
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path

import msgspec
from contestants.contest import BIDDERS, MAX_CONVERSATIONS, MESSAGES, Contestant, Measured, Ready, Round, take_part
from msgspec import Struct

from somrs.deployment.programs import run_program

WARM_UP = Round(seconds=1.0, concurrency=MAX_CONVERSATIONS)
START_TIME = 60.0
"""Seconds for a contestant to become ready."""

STALL_TIME = 30.0
"""Seconds after a round for a contestant to finish its last conversations."""

CLIENTS = "clients, and what starts the parts"
"""The part of a contestant that runs the conversations, in its first process."""

END_TIME = 15.0
"""Seconds for a contestant to end by itself."""


class Entry(Struct, frozen=True, kw_only=True):
    """A contestant: its module and class, its title, and the packages that it needs besides SO-MRS."""

    module: str
    kind: str
    title: str
    packages: tuple[str, ...] = ()
    apart: bool = False
    """It does something different, and is listed below the others."""


ENTRIES: dict[str, Entry] = {
    "floor": Entry(module="floor", kind="Floor", title="the floor: calls, msgpack, a journal"),
    "here": Entry(module="somrs_here", kind="InProcess", title="SO-MRS in one process"),
    "wire": Entry(module="somrs_wire", kind="OverHttp", title="SO-MRS, SOAP over HTTP"),
    "wire-secure": Entry(module="somrs_wire", kind="OverHttps", title="SO-MRS, SOAP over HTTPS, certificates"),
    "bus": Entry(module="somrs_wire", kind="OnBus", title="SO-MRS on a bus (NATS), journals too", packages=("nats",)),
    "bus-secure": Entry(module="somrs_wire", kind="OnSecureBus", title="SO-MRS on a bus, certificates", packages=("nats",)),
    "bus-two": Entry(module="somrs_wire", kind="OnBusWithTwo", title="SO-MRS on a bus, two Task Managers", packages=("nats",)),
    "soap": Entry(module="soap_exchange", kind="Exchange", title="SOAP over HTTP: one exchange", apart=True),
    "spade": Entry(module="spade_agents", kind="Spade", title="SPADE over its XMPP server", packages=("spade",)),
    "dbos": Entry(module="dbos_workflows", kind="Steps", title="DBOS on SQLite: steps", packages=("dbos",)),
    "dbos-messages": Entry(module="dbos_workflows", kind="Messages", title="DBOS on SQLite: send and recv", packages=("dbos",)),
}


@dataclass(slots=True, kw_only=True)
class Figures:
    """The measurements of one contestant with one number of conversations at a time."""

    rates: list[float] = field(default_factory=list)
    """Conversations per second, one figure for each round."""
    latencies: list[float] = field(default_factory=list)
    cpu: dict[str, float] = field(default_factory=dict)
    """CPU seconds of its processes, by part; empty if the operating system does not report them."""

    def add(self, measured: Measured, cpu: Mapping[str, float]) -> None:
        self.rates.append(len(measured.latencies) / measured.elapsed)
        self.latencies += measured.latencies
        for part, seconds in cpu.items():
            self.cpu[part] = self.cpu.get(part, 0.0) + seconds

    @property
    def rate(self) -> float:
        return statistics.median(self.rates)


class Failed(Exception):
    """A contestant could not be measured."""


class Child:
    """The process of a contestant."""

    def __init__(self, name: str, data: Path) -> None:
        self.name = name
        data.mkdir()
        self.log = data / "log"
        line = [sys.executable, str(Path(__file__).resolve()), "--contestant", name, "--data", str(data)]
        with self.log.open("wb") as errors:
            self._process = subprocess.Popen(
                line, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=errors, cwd=data, env={**os.environ, "TMPDIR": str(data)}
            )

    def ready(self) -> None:
        msgspec.json.decode(self._read_line(START_TIME), type=Ready)

    def measure(self, round: Round) -> tuple[Measured, dict[str, float]]:
        """Return the measurement, and the CPU seconds that it took, by part."""
        cpu_before = cpu_seconds(self._process.pid)
        assert self._process.stdin is not None
        self._process.stdin.write(msgspec.json.encode(round) + b"\n")
        self._process.stdin.flush()
        measured = msgspec.json.decode(self._read_line(round.seconds + STALL_TIME), type=Measured)
        cpu_after = cpu_seconds(self._process.pid)
        return measured, {part: seconds - cpu_before.get(part, 0.0) for part, seconds in cpu_after.items()}

    def end(self) -> None:
        assert self._process.stdin is not None
        self._process.stdin.close()
        try:
            self._process.wait(END_TIME)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _read_line(self, seconds: float) -> bytes:
        assert self._process.stdout is not None
        late = threading.Timer(seconds, self._process.kill)
        late.start()
        try:
            while line := self._process.stdout.readline():
                if line.startswith(b"{"):  # libraries print greetings on standard output, too
                    return line
        finally:
            late.cancel()
        log_text = self.log.read_text(errors="replace").strip()[-2000:] or "nothing"
        raise Failed(f"{ENTRIES[self.name].title}: it ended, or did not answer within {seconds:g} s; its log:\n{log_text}")


def cpu_seconds(root: int) -> dict[str, float]:
    """Return the CPU seconds of a process and its descendants, including ended ones that were waited for, by part."""
    if not Path("/proc").is_dir():
        return {}
    tick = os.sysconf("SC_CLK_TCK")
    times: dict[int, float] = {}
    parents: dict[int, int] = {}
    parts: dict[int, str] = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdecimal():
            try:
                fields = (entry / "stat").read_text().rpartition(")")[2].split()
                command_line = (entry / "cmdline").read_text().split("\0")
            except OSError:  # the process has just ended
                continue
            parents[int(entry.name)] = int(fields[1])
            times[int(entry.name)] = sum(map(int, fields[11:15])) / tick
            parts[int(entry.name)] = part_of(command_line)
    seconds_by_part: dict[str, float] = {}
    for pid, seconds in times.items():
        if root in _ancestors(pid, parents):
            part = parts[pid] if pid != root else CLIENTS
            seconds_by_part[part] = seconds_by_part.get(part, 0.0) + seconds
    return seconds_by_part


def part_of(command_line: Sequence[str]) -> str:
    """Return the part of a contestant that a process with this command line is: what its module is asked for, or the program's name."""
    for module, part in pairwise(command_line):
        if module.startswith("contestants."):
            return part
    return Path(command_line[0]).name


def _ancestors(pid: int, parents: dict[int, int]) -> Iterator[int]:
    """Yield the process and its ancestors."""
    while pid:
        yield pid
        pid = parents.get(pid, 0)


def compete(names: Sequence[str], rounds: int, seconds: float) -> dict[int, dict[str, Figures]]:
    """Measure the contestants in turns: each gets the same time in each round, with one conversation and with many at a time."""
    results: dict[int, dict[str, Figures]] = {concurrency: {name: Figures() for name in names} for concurrency in (1, MAX_CONVERSATIONS)}
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="coordination-")))
        children = {name: stack.enter_context(_running(name, folder / name)) for name in names}
        for child in children.values():
            child.ready()
            child.measure(WARM_UP)
        for _ in range(rounds):
            for name, child in children.items():
                for concurrency, figures in results.items():
                    figures[name].add(*child.measure(Round(seconds=seconds, concurrency=concurrency)))
    return results


@contextmanager
def _running(name: str, data: Path) -> Iterator[Child]:
    child = Child(name, data)
    try:
        yield child
    finally:
        child.end()


def table(concurrency: int, figures: dict[str, Figures]) -> None:
    first = next(iter(figures.values()))
    figures = {name: figures[name] for name in sorted(figures, key=lambda name: ENTRIES[name].apart)}
    print(f"\n{_conversations(concurrency):40} {'per second':>11} {'p50':>9} {'p99':>9} {'CPU each':>10} {'ratio':>8}")
    for name, entry_figures in figures.items():
        latencies = sorted(entry_figures.latencies)
        cpu = _cpu_each(entry_figures, sum(entry_figures.cpu.values())) if entry_figures.cpu else "-"
        print(
            f"  {ENTRIES[name].title:38} {entry_figures.rate:11.1f} {_ms(latencies, 0.5):>9} {_ms(latencies, 0.99):>9} {cpu:>10}"
            f" {entry_figures.rate / first.rate:8.3f}"
        )


def table_of_parts(figures: dict[str, Figures]) -> None:
    """Print the CPU of each part, of the contestants with several."""
    for name, entry_figures in figures.items():
        if len(entry_figures.cpu) > 1:
            print(f"\n  {ENTRIES[name].title + ', CPU each':60} {_cpu_each(entry_figures, sum(entry_figures.cpu.values())):>10}")
            for part, seconds in sorted(entry_figures.cpu.items(), key=lambda part: -part[1]):
                print(f"    {part:58} {_cpu_each(entry_figures, seconds):>10}")


def _cpu_each(figures: Figures, seconds: float) -> str:
    return f"{seconds / len(figures.latencies) * 1000:.3g} ms"


def _conversations(concurrency: int) -> str:
    return "one conversation at a time" if concurrency == 1 else f"{concurrency} conversations at a time"


def _ms(latencies: list[float], part: float) -> str:
    return f"{latencies[min(int(len(latencies) * part), len(latencies) - 1)] * 1000:.3g} ms"


def present(entry: Entry) -> bool:
    return all(find_spec(package) is not None for package in entry.packages)


def contestant(entry: Entry) -> Callable[[], Contestant]:
    create: Callable[[], Contestant] = getattr(import_module(f"contestants.{entry.module}"), entry.kind)
    return create


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").strip().splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"contestants: {', '.join(ENTRIES)} (default: all)")
    parser.add_argument("--rounds", type=int, default=3, help="number of rounds")
    parser.add_argument("--seconds", type=float, default=3.0, help="seconds for each contestant in a round")
    parser.add_argument("--contestant", choices=ENTRIES, help=argparse.SUPPRESS)
    parser.add_argument("--data", type=Path, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.contestant is not None:
        run_program(take_part(arguments.contestant, contestant(ENTRIES[arguments.contestant]), arguments.data))
        return
    if unknown := [name for name in arguments.names if name not in ENTRIES]:
        parser.error(f"there is no contestant {', '.join(unknown)}; there are {', '.join(ENTRIES)}")
    if arguments.rounds < 1 or not 0 < arguments.seconds <= 600:
        parser.error("--rounds has to be at least 1, and --seconds more than 0 and at most 600")
    selected = arguments.names or [*ENTRIES]
    for name in selected:
        if not present(ENTRIES[name]):
            print(f"{ENTRIES[name].title}: left out, because it is not installed; pip install -e '.[rivals]' installs it")
    taking_part = [name for name in selected if present(ENTRIES[name])]
    print(
        f"One coordinator, {BIDDERS} bidders, {MESSAGES} messages a conversation; {arguments.rounds} rounds of {arguments.seconds:g} s each"
    )
    if not taking_part:
        return
    try:
        results = compete(taking_part, arguments.rounds, arguments.seconds)
    except Failed as error:
        sys.exit(str(error))
    for concurrency, figures in results.items():
        table(concurrency, figures)
        table_of_parts(figures)


if __name__ == "__main__":
    main()
