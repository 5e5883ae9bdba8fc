"""Measures what a map costs by its size, up to a million objects, beside two stores of triples: rdflib and Oxigraph.

`python benchmarks/large_maps.py` measures 1,000 to 100,000 objects; `python benchmarks/large_maps.py 1000000` a million. Each store runs in
a process of its own. Times are CPU times of all its threads. `pip install -e ".[rivals]"` installs Oxigraph.
"""

from __future__ import annotations

import gc
import importlib.util
import itertools
import json
import math
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from timing import format_time

from somrs.deployment.programs import YOUNG_OBJECTS
from somrs.kernel.component import Received, Send
from somrs.kernel.durability import JournaledComponent
from somrs.kernel.replica import Replica
from somrs.ontology.files.loading import upper
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, Object
from somrs.ontology.types import Value
from somrs.planner.model.plan import Plan
from somrs.planner.planning import plan
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.directory import Offer
from somrs.protocol.messages.envelope import Header, Message, message_id
from somrs.protocol.messages.knowledge import MapChanged, MapPage, QueryMap, ReadMap, Rows, SubscribeMap, Updated, UpdateMap
from somrs.protocol.messages.submission import Submit
from somrs.repository.component import Repository
from somrs.repository.state import Contents
from somrs.storage.journal import Journal
from somrs.storage.repository_store import repository_journal
from somrs.task_manager.context import planning_problem

if TYPE_CHECKING:
    import rdflib

SIZES = (1_000, 10_000, 100_000)
STORES = ("somrs", "rdflib", "oxigraph")
ROOM = 51
"""Objects in a room: the room itself, 25 shelves, and a jar on each."""

REPOSITORY, FOLLOWER = "urn:repository", "urn:follower"
NAMESPACE = "urn:map:"
ROUNDS = 200

Figures = dict[str, float]


def contents(size: int) -> tuple[list[Object], list[Fact]]:
    """Return the objects and facts of a building: rooms with shelves, and a jar on each shelf."""
    floor: dict[str, Value] = {"PositionX": 0.0, "PositionY": 0.0, "PositionZ": 0.0, "Shape.Form": "Box"}
    floor |= {"Shape.Width": 1e4, "Shape.Depth": 1e4, "Shape.Height": 0.1}
    objects = [Object(name="Building1", type="Building"), Object(name="Storey1", type="Storey")]
    objects.append(Object(name="Floor1", type="Floor", values=floor))
    facts = [Fact("isPartOf", ("Storey1", "Building1")), Fact("isPartOf", ("Floor1", "Storey1"))]
    for number in range(size - len(objects)):
        room, place = divmod(number, ROOM)
        pair = room * (ROOM // 2) + (place - 1) // 2
        where: dict[str, Value] = {"PositionX": float(room % 1000 * 10), "PositionY": float(room // 1000 * 10 + place)}
        if place == 0:
            objects.append(Object(name=f"Room{room}", type="Room"))
            facts.append(Fact("isPartOf", (f"Room{room}", "Storey1")))
        elif place % 2:
            box: dict[str, Value] = {"Shape.Form": "Box", "Shape.Width": 1.0, "Shape.Depth": 0.5, "Shape.Height": 1.0}
            objects.append(Object(name=f"Shelf{pair}", type="Shelf", values={**where, "PositionZ": 0.0, **box}))
            facts.append(Fact("isPartOf", (f"Shelf{pair}", f"Room{room}")))
        else:
            values: dict[str, Value] = {**where, "PositionZ": 1.0, "Color": "Red" if pair % 10 else "Blue"}
            objects.append(Object(name=f"Jar{pair}", type="Jar", values=values))
            facts.append(Fact("isOn", (f"Jar{pair}", f"Shelf{pair}")))
    return objects, facts


def pairs(size: int) -> int:
    """Return the number of shelves that carry a jar."""
    return sum(object.type == "Jar" for object in contents(size)[0])


class Store(Protocol):
    """A store of the map in this process. Moving puts a jar on another shelf; each answer is checked."""

    def place_of(self, jar: int) -> str: ...

    def jars_on(self, shelf: int) -> set[str]: ...

    def move(self, jar: int, source: int, target: int) -> None: ...


def measure(store: str, size: int) -> Figures:
    """Return the figures of one store, in seconds and megabytes."""
    with tempfile.TemporaryDirectory() as folder:
        ways = {"somrs": somrs_figures, "rdflib": rdflib_figures, "oxigraph": oxigraph_figures}
        return ways[store](Path(folder), size)


def in_new_process(store: str, stage: str, folder: Path, size: int) -> None:
    """Have another process write the files, so that this one's memory is that of reading them."""
    subprocess.run([sys.executable, __file__, "write", store, str(folder), str(size)], check=True)


def access_figures(store: Store, size: int) -> Figures:
    """Return the times of queries and updates: the median, and the worst update."""
    numbers = [round(place) for place in _spread(pairs(size) - 1, ROUNDS)]

    def ask(number: int) -> None:
        assert store.place_of(number) == f"Shelf{number}"

    def look(number: int) -> None:
        assert store.jars_on(number) == {f"Jar{number}"}

    figures = {"place of a jar": statistics.median(_times(ask, numbers)), "what is on a shelf": statistics.median(_times(look, numbers))}
    moves = _times(lambda number: store.move(number, number, number + 1), numbers)
    assert store.jars_on(numbers[-1] + 1) == {f"Jar{numbers[-1]}", f"Jar{numbers[-1] + 1}"}
    return figures | {"a move": statistics.median(moves), "worst move": max(moves)}


def _spread(last: int, count: int) -> Iterator[float]:
    return (40 + (last - 42) * number / count for number in range(count))


def _times(work: Callable[[int], object], numbers: Sequence[int]) -> list[float]:
    times = []
    for number in numbers:
        started = time.process_time()
        work(number)
        times.append(time.process_time() - started)
    return times


def _seconds(work: Callable[[], object]) -> float:
    started = time.process_time()
    work()
    return time.process_time() - started


def _memory() -> float:
    """Return the resident megabytes of this process."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * 4096 / 1e6


# SO-MRS


class SomrsStore:
    """A Repository, as its messages reach it, without the transport."""

    def __init__(self, repository: Repository) -> None:
        self.repository = repository
        self._numbers = itertools.count()

    def ask(self, body: Body, sender: str = FOLLOWER) -> list[Send]:
        header = Header(sender=sender, recipient=REPOSITORY, message_id=message_id(next(self._numbers), "benchmark"))
        return self.handle(Message(header=header, body=body))

    def handle(self, message: Message) -> list[Send]:
        return [effect for effect in self.repository.handle(Received(message), 1.0) if isinstance(effect, Send)]

    def _rows(self, formula: str, variable: str) -> list[str]:
        rows = self.ask(QueryMap(formula=formula))[0].message.body
        assert isinstance(rows, Rows)
        return [row.bindings[variable] for row in rows.rows]

    def place_of(self, jar: int) -> str:
        return self._rows(f"Jar{jar} isOn ?Where", "Where")[0]

    def jars_on(self, shelf: int) -> set[str]:
        return set(self._rows(f"?What isOn Shelf{shelf}", "What"))

    def move(self, jar: int, source: int, target: int) -> None:
        answer = self.ask(UpdateMap(situation=f"Jar{jar} isOn Shelf{target}"))[0].message.body
        assert isinstance(answer, Updated), answer


def write_somrs(folder: Path, size: int) -> None:
    journal = repository_journal(folder / "repository.sqlite")
    objects, facts = contents(size)
    journal.begin(REPOSITORY, lambda address: Repository(address, Contents(ontology=upper(), map=Map(objects, facts))))
    journal.close()


def open_somrs(folder: Path) -> tuple[Journal, JournaledComponent]:
    journal = repository_journal(folder / "repository.sqlite")
    journaled, _ = journal.begin(REPOSITORY, lambda _: _missing())
    return journal, journaled


def _missing() -> Repository:
    raise AssertionError("the file is empty")


def somrs_figures(folder: Path, size: int) -> Figures:
    gc.set_threshold(YOUNG_OBJECTS)  # as in the programs
    upper()
    in_new_process("somrs", "write", folder, size)
    memory = _memory()
    opened: list[tuple[Journal, JournaledComponent]] = []
    figures = {"start": _seconds(lambda: opened.append(open_somrs(folder)))}
    journal, journaled = opened[0]
    repository = journaled.component
    assert isinstance(repository, Repository)
    store = SomrsStore(repository)
    store.ask(SubscribeMap(lease=1e9))
    figures["first query"] = _seconds(lambda: store.place_of(1))
    figures["first move"] = _seconds(lambda: store.move(0, 0, 1))
    figures["memory"] = _memory() - memory
    figures |= access_figures(store, size)
    figures["snapshot"] = _seconds(lambda: journal.snapshot(journaled))
    figures["its write"] = _seconds(journal.close)
    figures |= page_figures(store)
    return figures | follower_figures(store, size)


def page_figures(store: SomrsStore) -> Figures:
    """Return the time of a page of the map, after a change and without one."""

    def page() -> None:
        answer = store.ask(ReadMap(after="Jar5"))[0].message.body
        assert isinstance(answer, MapPage)
        assert answer.objects

    after_change = []
    for number in range(5):
        store.move(2, 2 + number, 3 + number)
        after_change.append(_seconds(page))
    return {"page after a change": statistics.median(after_change), "page again": statistics.median(_times(lambda _: page(), range(5)))}


def follower_figures(store: SomrsStore, size: int) -> Figures:
    """Return how long a follower takes to read the map and to apply a change, and a task to be planned."""
    replica = Replica(FOLLOWER, REPOSITORY)
    figures = {"follower reads": _seconds(lambda: _exchange(store, replica))}
    replica_times = []
    for number in range(20):
        answer, news = store.ask(UpdateMap(situation=f"Jar3 isOn Shelf{number + 5}"))
        assert isinstance(news.message.body, MapChanged), answer
        replica_times.append(_seconds(partial(replica.handle, Received(news.message), 1.0)))
    assert replica.map.has_fact("isOn", ("Jar3", "Shelf24"))
    transfer = replica.ontology.services["TransferObject"]
    offers = [
        Offer(
            service="urn:robot/transfer", service_type=transfer, provider="Robot1", provider_type="MobileManipulator", address="urn:robot"
        )
    ]

    def plan_move(number: int) -> None:
        task = Submit(effect=f"Jar{number} isOn Shelf{number + 1}")
        result = plan(planning_problem(task, replica, offers))
        assert isinstance(result, Plan), result

    first = _seconds(lambda: plan_move(7))
    again = statistics.median(_times(plan_move, range(8, 18)))
    return figures | {"change at a follower": statistics.median(replica_times), "first plan": first, "plan": again}


def _exchange(store: SomrsStore, replica: Replica) -> None:
    """Carry messages between the replica and the Repository until the replica has the map."""
    waiting = [effect.message for effect in replica.start(1.0) if isinstance(effect, Send)]
    while waiting:
        replies = [send.message for message in waiting for send in store.handle(message)]
        updates = [replica.handle(Received(message), 1.0) for message in replies]
        effects = [effect for update in updates if update is not None for effect in update.effects]
        waiting = [effect.message for effect in effects if isinstance(effect, Send)]
    assert replica.ready


# Triples


def triples(size: int) -> Iterator[tuple[str, str, str | float]]:
    """Return the same map as subjects, predicates and objects; a text that begins with the namespace is a name."""
    objects, facts = contents(size)
    for object in objects:
        yield object.name, "type", NAMESPACE + object.type
        yield from ((object.name, path, value) for path, value in object.values.items() if not isinstance(value, bool))
    for fact in facts:
        yield fact.arguments[0], fact.relation, NAMESPACE + fact.arguments[1]


def write_rdflib(folder: Path, size: int) -> None:
    with (folder / "map.nt").open("w") as file:
        for subject, predicate, value in triples(size):
            text = f"<{value}>" if isinstance(value, str) and value.startswith(NAMESPACE) else json.dumps(str(value))
            file.write(f"<{NAMESPACE}{subject}> <{NAMESPACE}{predicate}> {text} .\n")


class RdflibStore:
    """An rdflib Graph in memory. Its queries are the direct ones; those in SPARQL are measured beside them."""

    def __init__(self, path: Path) -> None:
        import rdflib

        self._graph = rdflib.Graph()
        self._graph.parse(path, format="nt")
        self._uri = rdflib.URIRef

    def _name(self, name: str) -> rdflib.URIRef:
        return self._uri(NAMESPACE + name)

    def place_of(self, jar: int) -> str:
        return str(next(self._graph.objects(self._name(f"Jar{jar}"), self._name("isOn")))).removeprefix(NAMESPACE)

    def jars_on(self, shelf: int) -> set[str]:
        return {str(s).removeprefix(NAMESPACE) for s in self._graph.subjects(self._name("isOn"), self._name(f"Shelf{shelf}"))}

    def move(self, jar: int, source: int, target: int) -> None:
        self._graph.remove((self._name(f"Jar{jar}"), self._name("isOn"), self._name(f"Shelf{source}")))
        self._graph.add((self._name(f"Jar{jar}"), self._name("isOn"), self._name(f"Shelf{target}")))

    def by_sparql(self, jar: int) -> None:
        rows = list(self._graph.query(f"SELECT ?where {{ <{NAMESPACE}Jar{jar}> <{NAMESPACE}isOn> ?where }}"))
        assert len(rows) == 1


def rdflib_figures(folder: Path, size: int) -> Figures:
    import rdflib  # noqa: F401  # its modules are not the map's memory

    write_rdflib(folder, size)
    gc.collect()
    memory = _memory()
    opened: list[RdflibStore] = []
    figures = {"start": _seconds(lambda: opened.append(RdflibStore(folder / "map.nt")))}
    store = opened[0]
    figures["memory"] = _memory() - memory
    figures["place of a jar, SPARQL"] = statistics.median(_times(store.by_sparql, range(1, 11)))
    return figures | access_figures(store, size)


class OxigraphStore:
    """An Oxigraph Store on disk. All its queries are SPARQL, as its users write them."""

    def __init__(self, path: Path) -> None:
        import pyoxigraph

        self._store = pyoxigraph.Store(str(path))
        self._ox = pyoxigraph

    def fill(self, size: int) -> None:
        ox = self._ox
        nodes = (
            (subject, predicate, ox.NamedNode(value) if isinstance(value, str) and value.startswith(NAMESPACE) else ox.Literal(value))
            for subject, predicate, value in triples(size)
        )
        self._store.bulk_extend(ox.Quad(ox.NamedNode(NAMESPACE + s), ox.NamedNode(NAMESPACE + p), node) for s, p, node in nodes)
        self._store.flush()

    def _column(self, query: str) -> list[str]:
        rows: Any = self._store.query(query)
        return [row[0].value.removeprefix(NAMESPACE) for row in rows]

    def place_of(self, jar: int) -> str:
        return self._column(f"SELECT ?where {{ <{NAMESPACE}Jar{jar}> <{NAMESPACE}isOn> ?where }}")[0]

    def jars_on(self, shelf: int) -> set[str]:
        return set(self._column(f"SELECT ?what {{ ?what <{NAMESPACE}isOn> <{NAMESPACE}Shelf{shelf}> }}"))

    def move(self, jar: int, source: int, target: int) -> None:
        on = f"<{NAMESPACE}Jar{jar}> <{NAMESPACE}isOn>"
        self._store.update(f"DELETE DATA {{ {on} <{NAMESPACE}Shelf{source}> }}; INSERT DATA {{ {on} <{NAMESPACE}Shelf{target}> }}")


def oxigraph_figures(folder: Path, size: int) -> Figures:
    in_new_process("oxigraph", "write", folder, size)
    memory = _memory()
    opened: list[OxigraphStore] = []
    figures = {"start": _seconds(lambda: opened.append(OxigraphStore(folder / "oxigraph")))}
    figures |= access_figures(opened[0], size)
    return figures | {"memory": _memory() - memory}


def write(store: str, folder: Path, size: int) -> None:
    if store == "oxigraph":
        OxigraphStore(folder / "oxigraph").fill(size)
    else:
        write_somrs(folder, size)


# The table


def show(size: int, figures: dict[str, Figures]) -> None:
    """Print the figures of all stores, and the ratios of SO-MRS to the others."""
    print(f"\n{f'{size:,} objects':26}" + "".join(f"{store:>14}" for store in figures))
    for row in dict.fromkeys(row for of_store in figures.values() for row in of_store):
        cells = [of_store.get(row, math.nan) for of_store in figures.values()]
        print(f"  {row:24}" + "".join(f"{_format(row, cell):>14}" for cell in cells))


def _format(row: str, figure: float) -> str:
    if math.isnan(figure):
        return ""
    return f"{figure:.0f} MB" if row == "memory" else format_time(figure)


def main(arguments: Sequence[str]) -> None:
    if arguments[:1] == ["write"]:
        write(arguments[1], Path(arguments[2]), int(arguments[3]))
        return
    if arguments[:1] == ["measure"]:
        print(json.dumps(measure(arguments[1], int(arguments[2]))))
        return
    stores = list(STORES)
    if importlib.util.find_spec("pyoxigraph") is None:
        print("OXIGRAPH IS NOT INSTALLED, so it is not measured: pip install -e '.[rivals]'", file=sys.stderr)
        stores.remove("oxigraph")
    for size in map(int, arguments or SIZES):
        figures = {}
        for store in stores:
            process = subprocess.run([sys.executable, __file__, "measure", store, str(size)], check=True, stdout=subprocess.PIPE, text=True)
            figures[store] = json.loads(process.stdout)
        show(size, figures)


if __name__ == "__main__":
    main(sys.argv[1:])
