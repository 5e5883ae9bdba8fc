"""The table of the processes of a site on a bus."""

from __future__ import annotations

import io

from rich.console import Console

from somrs.cli.status import processes_table
from somrs.storage.running_component import RunningComponent


def test_the_table_says_why_the_bus_stores_nothing_of_a_component() -> None:
    problem = "the bus does not store the inputs of yard.registry: insufficient resources"
    leader = RunningComponent(component="registry", host="left", process=1, leads=True, number=9, problem=problem)
    standby = RunningComponent(component="registry", host="right", process=2, leads=False, number=7)
    output = io.StringIO()
    Console(file=output, width=200).print(processes_table([leader, standby]))
    lines = output.getvalue().splitlines()
    assert [line for line in lines if "leads" in line]
    assert [line for line in lines if problem in line]
    assert [line for line in lines if "standby" in line and "7" in line and "2" in line]
