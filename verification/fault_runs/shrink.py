"""Reduces a failing scenario to a short one that fails in the same way: removes faults first, then tasks, then devices."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import TypeVar

from verification.fault_runs.scenario import DeviceTraits, Fault, Scenario, TaskRequest

T = TypeVar("T")

MAX_TRIES = 600
"""The limit on the scenarios that are played."""


def shrink_scenario(scenario: Scenario, fails: Callable[[Scenario], bool]) -> Scenario:
    """Return the shortest failing scenario found."""
    tries = 0

    def still_fails(candidate: Scenario) -> bool:
        nonlocal tries
        tries += 1
        return tries <= MAX_TRIES and fails(candidate)

    for _ in range(2):
        scenario = _with_faults(scenario, minimize(scenario.faults, partial(_fails, still_fails, _with_faults, scenario)))
        scenario = _with_requests(scenario, minimize(scenario.requests, partial(_fails, still_fails, _with_requests, scenario)))
        scenario = _with_devices(scenario, minimize(scenario.devices, partial(_fails, still_fails, _with_devices, scenario)))
    plain = tuple(
        replace(request, handlers=(), cancelled=None, deadline=None, priority=0, previewed=False) for request in scenario.requests
    )
    for simpler in (replace(scenario, planning=0.0), replace(scenario, requests=plain), replace(scenario, planning=0.0, requests=plain)):
        if simpler != scenario and still_fails(simpler):
            scenario = simpler
    return scenario


def _fails(
    still_fails: Callable[[Scenario], bool], build: Callable[[Scenario, list[T]], Scenario], scenario: Scenario, remaining: list[T]
) -> bool:
    return still_fails(build(scenario, remaining))


def _with_faults(scenario: Scenario, faults: list[Fault]) -> Scenario:
    return replace(scenario, faults=tuple(faults))


def _with_requests(scenario: Scenario, requests: list[TaskRequest]) -> Scenario:
    return replace(scenario, requests=tuple(requests))


def _with_devices(scenario: Scenario, devices: list[DeviceTraits]) -> Scenario:
    return replace(scenario, devices=tuple(devices))


def minimize(items: Sequence[T], fails: Callable[[list[T]], bool]) -> list[T]:
    """Delta debugging (Zeller and Hildebrandt 2002): return a list from which no item can be removed while `fails` stays true."""
    remaining, part_count = [*items], 2
    if remaining and fails([]):
        return []
    while len(remaining) >= 2:
        size = -(-len(remaining) // part_count)
        for start in range(0, len(remaining), size):
            shorter = remaining[:start] + remaining[start + size :]
            if fails(shorter):
                remaining, part_count = shorter, max(part_count - 1, 2)
                break
        else:
            if size == 1:
                break
            part_count = min(part_count * 2, len(remaining))
    return remaining
