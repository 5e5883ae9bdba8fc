"""Draws a scenario from a seed. The same seed gives the same scenario on every machine."""

from __future__ import annotations

import random
from collections.abc import Iterator
from dataclasses import replace

from somrs.ontology.services import Handler, Occasion
from somrs.protocol.messages.submission import Policy
from somrs.runtime.virtual_time import KillPoint
from verification.fault_runs.scenario import (
    AT_WORK,
    MAPS,
    Carry,
    Cut,
    Departure,
    DeviceTraits,
    Disturbance,
    Fault,
    Kill,
    Loss,
    Move,
    Partition,
    Scenario,
    Setting,
    Sight,
    Slam,
    Store,
    Survey,
    TakeOver,
    TaskRequest,
    Undo,
    WorkFault,
    WorkFaultKind,
)
from verification.fault_runs.site import FLOOR, RECOGNITION, RESERVATION, SERVICES, WEIGHING

OFTEN, SELDOM, RARELY = 0.5, 0.15, 0.05
"""Probabilities."""

EVENTFUL = 90.0
"""Seconds from the start within which faults begin."""


def draw(seed: int) -> Scenario:
    """Return the scenario of the seed."""
    return _Draw(seed).scenario()


class _Draw:
    def __init__(self, seed: int) -> None:
        self.seed = seed
        self.dice = dice = random.Random(seed)
        self.more_dice = random.Random(f"{seed}: how urgent, and whether it is asked what it costs")
        self.waiting_dice = random.Random(f"{seed}: which tasks wait, and which devices are mended late")
        self.questions = random.Random(f"{seed}: what is asked, and what is not known")
        self.telling_dice = random.Random(f"{seed}: what is weighed, computed and sighted, and what undoing costs")
        self.registry_dice = random.Random(f"{seed}: how many Registries there are, and what happens to them")
        self.map_dice = random.Random(f"{seed}: how many maps there are, and who does not reach whom")
        self.repositories = self.map_dice.choice((1, 1, 1, 2, 2, 3))
        self.registries = 2 if self.registry_dice.random() < OFTEN and self.repositories == 1 else 1
        self.setting = dice.choice(list(Setting))
        self.managers = [f"tm{number}" for number in range(1, dice.choice((1, 1, 2, 3, 4)) + 1)]
        self.tables = [f"Table{number}" for number in range(1, dice.randint(2, 4) + 1)]
        self.doors = [(f"Door{number}", self.chance(SELDOM)) for number in range(1, dice.randint(1, 2) + 1)]
        self.shelves = [(f"Shelf{number}", dice.choice(self.doors)[0]) for number in range(1, dice.randint(1, 3) + 1)]
        self.supports = [*self.tables, *(shelf for shelf, _ in self.shelves)]
        self.things = [(f"Jar{number}", dice.choice(self.tables)) for number in range(1, dice.choice((3, 4, 5, 6, 10)) + 1)]
        self.store = self.more_dice.choice(list(Store)) if self.setting is Setting.DOORS else Store.PRECONDITION
        self.carry = Carry.WEIGHED if self.setting is Setting.FLAT and self.telling_dice.random() < OFTEN else Carry.PLAIN
        self.hidden = [f"Hidden{number}" for number in range(1, self.telling_dice.choice((0, 0, 1, 2)) + 1)]
        if self.repositories > 1:  # each Repository names new things for itself
            self.hidden = []
        self.devices = [*self._devices()]
        self.count = dice.choice((1, 1, 2, 2, 3, 4, 6, 8))
        self.quarrel = self.chance(OFTEN)
        """Whether several tasks may have goals for the same things."""
        self.unclaimed = [thing for thing, _ in self.things]

    def chance(self, probability: float) -> bool:
        return self.dice.random() < probability

    def seconds(self, maximum: float) -> float:
        return round(self.dice.random() * maximum, 2)

    def scenario(self) -> Scenario:
        return Scenario(
            seed=self.seed,
            setting=self.setting,
            managers=len(self.managers),
            registries=self.registries,
            repositories=self.repositories,
            tables=tuple(self.tables),
            shelves=tuple(self.shelves),
            doors=tuple(self.doors),
            things=tuple(self.things),
            devices=(*self.devices, *self._tellers()),
            requests=tuple(self._requests()),
            faults=(*self._faults(), *self._registry_kills(), *self._host_faults()),
            planning=self.dice.choice((0.0, 0.0, 0.5, 8.0)),
            hidden=tuple((thing, self.telling_dice.choice(self.supports)) for thing in self.hidden),
            weights=tuple(self._weights()),
        )

    def _weights(self) -> Iterator[tuple[str, float]]:
        if self.carry is Carry.WEIGHED:
            for thing in (*(thing for thing, _ in self.things), *self.hidden):
                yield thing, self.telling_dice.choice((0.5, 0.5, 3.0))

    # Devices

    def _devices(self) -> Iterator[DeviceTraits]:
        kinds = SERVICES[self.setting]
        count = self.dice.choice((5, 5, 6, 6, 7, 8, 10, 12, 16, 20))
        observer_count = self.dice.choice((0, 1, 1, 2))
        for number in range(count):
            yield self._device_traits(
                f"Robot{number + 1}", kinds[number % len(kinds)] if number < count - observer_count else (RECOGNITION,)
            )

    def _tellers(self) -> Iterator[DeviceTraits]:
        """Scales, and a program that reserves tables."""
        dice = self.telling_dice
        services = [WEIGHING] * dice.choice((1, 2, 3)) + [RESERVATION] * dice.choice((1, 2)) if self.carry is Carry.WEIGHED else []
        for number, service in enumerate(services, 1):
            yield DeviceTraits(
                name=f"Teller{number}",
                services=(service,),
                price=dice.randint(1, 9),
                duration=dice.choice((1.0, 6.0)),
                refuses=dice.random() < RARELY,
                mute=dice.random() < RARELY,
                mended_at=dice.choice((20.0, 60.0)) if dice.random() < SELDOM else 0.0,
                joins=dice.choice((5.0, 30.0)) if dice.random() < RARELY else 0.0,
            )

    def _device_traits(self, name: str, services: tuple[str, ...]) -> DeviceTraits:
        dice = self.dice
        variants: dict[str, str] = {Store.PRECONDITION: self.store.value, Carry.PLAIN: self.carry.value}
        traits = DeviceTraits(
            name=name,
            services=tuple(variants.get(service, service) for service in services),
            price=dice.randint(1, 9),
            duration=dice.choice((3.0, 6.0, 12.0, 18.0)),
            undo=dice.choice((Undo.RESTORE, Undo.RESTORE, Undo.RESTORE, Undo.IMPOSSIBLE, Undo.IMPOSSIBLE, Undo.FAIL, Undo.HANG)),
            refuses=self.chance(RARELY),
            mute=self.chance(RARELY),
            valid_for=dice.choice((60.0, 60.0, 60.0, 60.0, 5.0, 0.5)),
            halts=dice.choice((0.2, 1.0, 5.0, 14.0)),
            lease=dice.choice((30.0, 90.0, 90.0, 90.0)),
            joins=self.seconds(60) if self.chance(RARELY) else 0.0,
            drops=self.chance(OFTEN),
            lays_down=self.chance(OFTEN),
            mended_at=self.waiting_dice.choice((20.0, 60.0, 200.0)) if self.waiting_dice.random() < SELDOM else 0.0,
            refuses_conditionally=self.store is Store.CONDITION and self.more_dice.random() < OFTEN,
        )
        penalized = traits.undo is not Undo.IMPOSSIBLE and self.telling_dice.random() < OFTEN
        return replace(
            traits,
            penalty=self.telling_dice.choice((0.0, 1.0, 5.0)) if penalized else None,
            payload=self.telling_dice.choice((1.0, 5.0, 5.0)) if self.carry is Carry.WEIGHED else traits.payload,
        )

    # Tasks

    def _requests(self) -> Iterator[TaskRequest]:
        for _ in range(self.count):
            if not self.quarrel and not self.unclaimed:
                return
            yield self._request()

    def _request(self) -> TaskRequest:
        dice = self.dice
        request = TaskRequest(
            at=self.seconds(40) if self.chance(OFTEN) else 0.0,
            task_manager=dice.choice(self.managers),
            effect=self._effect(),
            deadline=dice.choice((15.0, 60.0, 300.0)) if self.chance(SELDOM) else None,
            policy=dice.choice(list(Policy)),
            handlers=tuple(self._handlers()),
            cancelled=self.seconds(60) if self.chance(SELDOM) else None,
            priority=self.more_dice.choice((0, 0, 0, -1, 1, 5)),
            previewed=self.more_dice.random() < 2 * SELDOM,
            recognise=self.questions.random() < SELDOM,
        )
        if self.carry is Carry.WEIGHED:
            request = replace(request, effect=self._told_effect(request))
        if self.waiting_dice.random() < OFTEN:  # without a deadline, it could wait for ever
            deadline = request.deadline or self.waiting_dice.choice((300.0, 900.0, 3600.0))
            return replace(request, waits=True, deadline=deadline)
        return request

    def _effect(self) -> str:
        dice = self.dice
        candidates = [thing for thing, _ in self.things] if self.quarrel else self.unclaimed
        chosen = dice.sample(candidates, min(dice.choice((1, 1, 1, 2, 2, 3)), len(candidates)))
        self.unclaimed = [thing for thing in self.unclaimed if thing not in chosen]
        goals = [f"{thing} isOn {dice.choice(self.supports)}" for thing in chosen]
        if len(goals) == 1 and self.chance(SELDOM) and self.quarrel:
            return f"?It: Jar isOn {dice.choice(self.supports)}"
        if len(goals) == 2 and self.chance(SELDOM):
            return " OR ".join(goals)
        if self.setting is Setting.DOORS and self.chance(OFTEN):
            door, _ = dice.choice(self.doors)
            goals.append(f"{door}.Open = {dice.choice(('TRUE', 'FALSE', 'FALSE'))}")
        return " AND ".join(goals)

    def _told_effect(self, request: TaskRequest) -> str:
        """The effect of the request, or one for which something has to be computed or found out."""
        effect = request.effect.replace("?It: Jar", "?It: Parcel")
        thing, _, rest = effect.partition(" isOn ")
        if not thing.isalnum() or not rest.isalnum() or self.telling_dice.random() < SELDOM:
            return effect
        return f"{thing}.Weight = ?Weight" if request.recognise else f"{thing} isOn ?Table AND ?Table isReservedFor {thing}"

    def _handlers(self) -> Iterator[Handler]:
        carrying = {Setting.FLAT: self.carry.value, Setting.DOORS: "CarryObject", Setting.GRIP: "PutDown"}[self.setting]
        table = self.dice.choice(self.tables)
        if self.chance(SELDOM):
            yield Handler(on=Occasion.FAILURE, service_type=carrying, when=f"?Object isOn {FLOOR}", effect=f"?Object isOn {table}")
        if self.chance(RARELY):
            yield Handler(on=Occasion.COMPENSATION, service_type=carrying, effect=f"?Object isOn {table}")

    # Faults

    def _faults(self) -> Iterator[Fault]:
        for thing, _ in self.things:
            if self.questions.random() < RARELY:
                yield Loss(at=round(self.questions.random() * EVENTFUL / 2, 2), object=thing)
        for _ in range(self.dice.choice((0, 1, 1, 2, 2, 3, 4, 5, 6, 8))):
            yield from self.dice.choice(
                (
                    self._work_fault,
                    self._work_fault,
                    self._work_fault,
                    self._kill,
                    self._kill_manager,
                    self._cut,
                    self._disturbance,
                    self._person,
                )
            )()
        for _ in range(self.telling_dice.choice((0, 1, 2, 4)) if self.hidden or self.telling_dice.random() < SELDOM else 0):
            yield Survey(at=round(self.telling_dice.random() * 2 * EVENTFUL, 2), place=self.telling_dice.choice([*self.supports, FLOOR]))
        if self.setting is Setting.DOORS:
            for _ in range(self.more_dice.choice((0, 0, 1, 2))):
                door, _ = self.more_dice.choice(self.doors)
                at = round(self.more_dice.random() * EVENTFUL, 2)
                yield Slam(at=at, door=door, is_open=self.more_dice.random() < SELDOM)

    def _device(self) -> DeviceTraits:
        return self.dice.choice(self.devices)

    def _work_fault(self) -> Iterator[Fault]:
        dice = self.dice
        kind = dice.choice(list(WorkFaultKind))
        if self.chance(SELDOM):
            yield WorkFault(device=self._device().name, nth=dice.choice((0, 0, 1)), kind=kind)
        else:
            yield WorkFault(nth=dice.choice((0, 0, 1, 1, 2, 3, 5, 8)), kind=kind)
        if self.chance(SELDOM):
            yield Sight(at=self.seconds(2 * EVENTFUL), object=self.dice.choice(self.things)[0])

    def _kill_manager(self) -> Iterator[Fault]:
        yield self._killing(self.dice.choice(self.managers), final=False)

    def _kill(self) -> Iterator[Fault]:
        if self.chance(SELDOM * 2):
            yield self._killing(self.dice.choice(("repository", "registry")), final=False)
        else:
            yield self._killing(AT_WORK if self.chance(OFTEN) else self._device().address, final=True)

    def _registry_kills(self) -> Iterator[Fault]:
        """One of two Registries is killed, perhaps for good."""
        dice = self.registry_dice
        if self.registries > 1 and dice.random() < OFTEN:
            yield Kill(
                at=round(dice.random() * EVENTFUL, 2),
                target=dice.choice(("registry", "registry-2")),
                moment=dice.choice(list(KillPoint)),
                effects=dice.randint(0, 4),
                seconds=dice.choice((None, None, 2.0, 25.0, 90.0)),
                snapshot=dice.random() < OFTEN,
            )

    def _host_faults(self) -> Iterator[Fault]:
        """Between components: partitions, hosts that are lost for good, and Repositories and Registries of further maps that are killed."""
        dice = self.map_dice
        central = [*(f"repository{suffix}" for suffix in self._suffixes()), *(f"registry{suffix}" for suffix in self._suffixes())]
        replicated = [*self.managers, *central]
        for _ in range(dice.choice((0, 0, 1, 2, 3)) if self.repositories > 1 else 0):
            target, seconds = dice.choice(central), dice.choice((0.1, 2.0, 10.0, 25.0, 50.0))
            at, moment, effects = self._map_time(), dice.choice(list(KillPoint)), dice.randint(0, 4)
            yield Kill(at=at, target=target, moment=moment, effects=effects, seconds=seconds, snapshot=dice.random() < OFTEN)
        for _ in range(dice.choice((0, 0, 0, 1, 1, 2))):
            yield TakeOver(
                at=self._map_time(),
                target=dice.choice(replicated),
                moment=dice.choice(list(KillPoint)),
                effects=dice.randint(0, 4),
                seconds=dice.choice((0.5, 2.6, 12.0)),
                lingers=dice.choice((0.0, 0.0, 5.0, 30.0)),
            )
        for _ in range(dice.choice((0, 0, 1, 2, 3))):
            one, other = dice.sample([*replicated, *(device.address for device in dice.sample(self.devices, 2))], 2)
            yield Partition(at=self._map_time(), one=one, other=other, seconds=dice.choice((2.0, 12.0, 30.0, 70.0, 150.0)))

    def _suffixes(self) -> list[str]:
        return ["", *(f"-{map}" for map in MAPS[1 : self.repositories])]

    def _map_time(self) -> float:
        return round(self.map_dice.random() * EVENTFUL, 2)

    def _killing(self, target: str, *, final: bool) -> Kill:
        dice = self.dice
        return Kill(
            at=self.seconds(EVENTFUL),
            target=target,
            moment=dice.choice(list(KillPoint)),
            effects=dice.randint(0, 4),
            seconds=None if final and self.chance(OFTEN) else dice.choice((0.1, 2.0, 10.0, 25.0, 50.0)),
            snapshot=self.chance(OFTEN),
        )

    def _cut(self) -> Iterator[Fault]:
        target = self.dice.choice((AT_WORK, AT_WORK, self._device().address, *self.managers, "repository", "registry"))
        yield Cut(at=self.seconds(EVENTFUL), target=target, seconds=self.dice.choice((2.0, 12.0, 18.0, 30.0, 70.0)))

    def _disturbance(self) -> Iterator[Fault]:
        dice = self.dice
        yield Disturbance(
            at=self.seconds(EVENTFUL / 2),
            seconds=dice.choice((20.0, 60.0, 120.0)),
            lost=dice.choice((0.0, 0.1, 0.4)),
            twice=dice.choice((0.0, 0.2)),
            late=dice.choice((0.0, 0.3, 2.0)),
        )

    def _person(self) -> Iterator[Fault]:
        if self.chance(SELDOM):
            yield Departure(at=self.seconds(EVENTFUL), device=self._device().name)
            return
        thing = self.dice.choice(self.things)[0]
        start_time = self.seconds(EVENTFUL)
        yield Move(at=start_time, thing=thing, place=self.dice.choice([*self.supports, FLOOR]), is_reported=self.chance(OFTEN))
        if self.chance(OFTEN):
            yield Sight(at=start_time + self.seconds(60), object=thing)
