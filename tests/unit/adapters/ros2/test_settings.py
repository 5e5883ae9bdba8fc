"""Settings and binding files, and what is said of those that are wrong."""

from __future__ import annotations

import re
import textwrap
from pathlib import Path

import pytest
import yaml

from somrs.adapters.ros2.adapter import Ros2Adapter
from somrs.adapters.ros2.binding_file import read_binding
from somrs.adapters.ros2.settings import Binding, RobotSettings, full_name, read_settings
from somrs.errors import InputError, SettingsError


def _problem(tmp_path: Path, text: str) -> str:
    file = tmp_path / "robot.yaml"
    file.write_text(text)
    with pytest.raises(InputError) as info:
        read_binding(file)
    return str(info.value).replace(f"{tmp_path}/", "")


def test_an_empty_binding_is_a_robot_with_nav2_that_only_drives(tmp_path: Path) -> None:
    file = tmp_path / "robot.yaml"
    file.write_text("")
    binding = read_binding(file)
    assert (binding.navigate.action, binding.navigate.type) == ("navigate_to_pose", "nav2_msgs/action/NavigateToPose")
    assert (binding.pick, binding.charge) == ((), None)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("navigate:\n  acton: go\n", "robot.yaml:2: navigate.acton: unknown key acton; did you mean action?"),
        ("odometri: {}\n", "robot.yaml:1: odometri: unknown key odometri; did you mean odometry?"),
        (
            "attributes:\n  Charge:\n    topic: battery\n",
            "robot.yaml:2: attributes.Charge.type: type is missing; write type: sensor_msgs/msg/BatteryState",
        ),
        (
            "navigate:\n  goal: {pose: '{z}'}\n",
            "robot.yaml:2: navigate.goal: has {z}, for which there is no value; there are {frame}, {path}",
        ),
        (
            "pick:\n  - {action: a, type: p/action/A, goal: {a: '{thingy}'}}\n",
            "pick.0: has {thingy}, for which there is no value; there are {frame}, {qw}, {qz}, {robot}, {support}, {thing}",
        ),
        ("pick:\n  - {action: a, type: p/action/A}\n", "drop: is missing: a robot that carries things has `pick` and `drop`"),
        ("pick:\n  action: a\n", "robot.yaml:1: pick: pick should be a list, [...], not {'action': 'a'}"),
        ("charge: {}\n", "`charge` ends by the attribute Charge, which is not bound: write the topic"),
        (
            "charge: {}\nattributes:\n  Chargee: {topic: battery, type: p/msg/A}\n",
            "robot.yaml:3: attributes.Chargee: `charge` ends by the attribute Charge, which is not bound: it is written Chargee",
        ),
        ("charge:\n  full: much\n", "robot.yaml:2: charge.full: full should be a number in percent, not 'much'"),
        ("drop:\n  - {action: a, topic: b, type: p/action/A}\n", "robot.yaml:2: drop.0: a step has one of `action`, `service` and `topic`"),
        ("drop:\n  - {service: a, goal: {a: 1}, type: p/srv/A}\n", "a step with `service` has `request`, and no `goal`"),
        ("drop:\n  - {service: a, type: p/action/A}\n", "'p/action/A' is no type of services: write PACKAGE/srv/NAME"),
        ("odometry: {type: nav_msgs/Odometry}\n", "'nav_msgs/Odometry' is no type of messages: write PACKAGE/msg/NAME"),
        ("odometry: {topic: my odom}\n", "odometry.topic: 'my odom' is no name of ROS 2"),
        ("pose: {field: 3a}\n", "robot.yaml:1: pose.field: '3a' is not a path of fields"),
        (
            "pose: {field: pose}\n",
            "pose.field: the pose in geometry_msgs/msg/PoseWithCovarianceStamped is pose.pose: write field: pose.pose",
        ),
        ("pose: {type: geometry_msgs/msg/PoseStamped}\n", "write field: pose"),
        ("pose: {}\ntransform: {}\n", "robot.yaml:2: transform: is not read, because there is a `pose`"),
        (
            "odometry:\n\ttopic: odom\n",
            "robot.yaml:2: file: this is not YAML: found character that cannot start any token; lines begin with spaces",
        ),
        ("moves: {speed: .inf}\n", "speed should be a finite number in m/s, not inf"),
        ("- pose\n", "robot.yaml:1: file: a binding is a list of keys (pose, "),
        ("pose: [\n", "robot.yaml:2: file: this is not YAML"),
    ],
)
def test_a_binding_that_is_wrong_says_where_and_what(tmp_path: Path, text: str, problem: str) -> None:
    assert problem in _problem(tmp_path, text)


def test_settings_that_are_wrong_say_where_and_what() -> None:
    with pytest.raises(InputError, match=r"adapters\.ros2\.robots\.Robot1\.binding: binding is missing; write binding: robot\.yaml"):
        read_settings({"robots": {"Robot1": {}}})
    robot = {"binding": "robot.yaml", "namespace": "r 1", "levels": [{"yaw": "28.6 deg"}]}
    with pytest.raises(SettingsError) as info:
        read_settings({"domain": 500.0, "discovery": "LOCAL", "robots": {"Robot1": robot}})
    assert str(info.value).replace("adapters.ros2.", "").splitlines() == [
        "domain: domain should be at most 232, not 500",
        "discovery: discovery should be 'OFF', 'LOCALHOST', 'SUBNET' or 'SYSTEM_DEFAULT', not 'LOCAL'; did you mean LOCALHOST?",
        "robots.Robot1.namespace: 'r 1' is no name of ROS 2: write letters, digits and _ between slashes, such as robot1/odom",
        "robots.Robot1.levels.0.yaw: yaw should be a number in rad, not '28.6 deg'",
    ]


def test_an_adapter_serves_the_robots_that_its_settings_name(tmp_path: Path) -> None:
    (tmp_path / "robot.yaml").write_text("odometry: {}\n")
    robot = {"binding": "robot.yaml"}
    assert {*Ros2Adapter({"robots": {"Robot1": robot, "Robot2": robot}}, tmp_path).names} == {"Robot1", "Robot2"}
    with pytest.raises(InputError, match=r"robots\.Robot1\.binding: there is no file .*nothing\.yaml"):
        Ros2Adapter({"robots": {"Robot1": {"binding": "nothing.yaml"}}}, tmp_path)


@pytest.mark.parametrize(
    ("name", "namespace", "full"),
    [("odom", "", "/odom"), ("odom", "/robot1/", "/robot1/odom"), ("/tf", "robot1", "/tf"), ("a/b", "x/y", "/x/y/a/b")],
)
def test_names_are_in_the_namespace_of_the_robot(name: str, namespace: str, full: str) -> None:
    assert full_name(name, namespace) == full


def test_the_example_is_a_binding() -> None:
    binding = read_binding(Path("examples/ros2_robot.yaml"))
    assert (len(binding.pick), len(binding.drop), [*binding.attributes]) == (1, 1, ["Charge"])


def test_what_the_guide_shows_is_valid() -> None:
    guide = Path("docs/how-to/connect-ros2-robots.md").read_text()
    blocks = [yaml.safe_load(textwrap.dedent(block)) for block in re.findall(r"```yaml\n(.*?)```", guide, re.DOTALL)]
    settings = [block["adapters"]["ros2"] for block in blocks if "adapters" in block]
    levels = [block for block in blocks if "levels" in block]
    bindings = [block for block in blocks if block.keys() & {"attributes", "pick"}]
    assert [len(found) for found in (settings, levels, bindings)] == [2, 1, 3]
    for entry in settings:
        read_settings(entry)
    RobotSettings.model_validate({"binding": "robot.yaml", **levels[0]})
    for binding in bindings:
        Binding.model_validate({**binding, **({"drop": binding["pick"]} if "pick" in binding else {})})
