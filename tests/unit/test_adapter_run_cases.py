"""The adapter runs have every case, and draw the same run for the same seed."""

from __future__ import annotations

from collections import Counter

from verification.adapter_runs.cases import CASES, KINDS, LONG, RIDES, SHORT, Phase, draw


def test_every_part_and_pair_is_killed_in_every_phase_once() -> None:
    assert len({*CASES}) == len(CASES) == sum(map(len, (*KINDS, *RIDES)))
    for cases in (*KINDS, *RIDES):
        phases, victims = {case.phase for case in cases}, {case.victims for case in cases}
        assert len(cases) == len(phases) * len(victims)
    assert {case.phase for case in CASES} == {*Phase}
    assert Counter(case.kind for case in CASES)["vda5050 3.0"] == 25


def test_a_seed_gives_one_run() -> None:
    runs = [draw(seed) for seed in range(2 * len(CASES))]
    assert [run.case for run in runs] == [*CASES, *CASES]
    assert runs == [draw(seed) for seed in range(len(runs))]
    assert all(SHORT[0] <= run.outage <= SHORT[1] or LONG[0] <= run.outage <= LONG[1] for run in runs)
