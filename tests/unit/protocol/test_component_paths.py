"""The paths of SO-MRS in addresses, and addresses whose scheme changes."""

from __future__ import annotations

import pytest

from somrs.client.addresses import registry_path, task_manager_path
from somrs.protocol.component_paths import FIRST_PARTS, is_of_component, scheme_change
from somrs.runtime.places import PATHS

PLAIN, SECURE = "http://10.0.0.1:8600/task-manager", "https://10.0.0.1:8600/task-manager"


def test_all_paths_at_which_programs_listen_are_known() -> None:
    for path in {pattern.partition(".")[0] for patterns in PATHS.values() for pattern in patterns}:
        assert is_of_component(f"http://here:1/{path}"), path
    assert all(is_of_component(f"https://here:1{path(2)}") for path in (registry_path, task_manager_path))
    assert "api" not in FIRST_PARTS, "people and their programs have no certificates"


@pytest.mark.parametrize("address", ["http://here:1/robot", "http://here:1/", "http://here:1", "urn:repository", "repository"])
def test_other_addresses_are_free_for_others(address: str) -> None:
    assert not is_of_component(address)


def test_only_the_scheme_of_own_addresses_changes() -> None:
    change = scheme_change(PLAIN, SECURE)
    assert change is not None
    kept = ["http://10.0.0.1:9000/robot", "http://10.0.0.2:8600/repository", "http://10.0.0.1:8601/api", "http://110.0.0.1:1/registry"]
    earlier = {"devices": {"http://10.0.0.1:8602/devices/Robot1": [1, None, True, b"http://"]}, "kept": kept}
    later = {"devices": {"https://10.0.0.1:8602/devices/Robot1": [1, None, True, b"http://"]}, "kept": kept}
    assert change(earlier) == later
    back = scheme_change(SECURE, PLAIN)
    assert back is not None
    assert back(later) == earlier
    setting = "the Repository at http://10.0.0.1:1/repository, the Registry at http://10.0.0.1:2/registry-2"
    assert change(setting) == setting.replace("http:", "https:")


@pytest.mark.parametrize("address", [PLAIN, SECURE.replace("10.0.0.1", "10.0.0.2"), "something else", ""])
def test_another_change_of_an_address_is_none_of_its_scheme(address: str) -> None:
    assert scheme_change(PLAIN, address) is None
