"""Reads binding files, and says what is wrong with them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path as FilePath

from somrs.adapters.ros2.settings import AROUND_CORNERS, POSE_NAMES, Binding, unknown_in_steps, unknown_names
from somrs.adapters.settings import checked
from somrs.entish.parse import nearest
from somrs.errors import InputError, Mistake, ModelError, Problem
from somrs.ontology.files.nodes import Path, Source

POSES = {
    "geometry_msgs/msg/PoseWithCovarianceStamped": "pose.pose",
    "geometry_msgs/msg/PoseStamped": "pose",
    "geometry_msgs/msg/Pose": "",
    "nav_msgs/msg/Odometry": "pose.pose",
}
"""Where the pose is in messages of these types."""


def read_binding(file: FilePath) -> Binding:
    """The content of a binding file. Raises InputError, with the lines of all problems."""
    try:
        source = Source(str(file), file.read_text("utf-8-sig"))
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise InputError(f"{file} cannot be read: {reason}; correct the path of the binding, which is relative to the site file") from None
    if source.problems:
        raise ModelError(source.problems)
    if not isinstance(source.data, dict | None):
        text = f"a binding is a list of keys ({', '.join(Binding.model_fields)}) with values"
        raise ModelError([Problem(file=source.file, line=1, subject="file", rule="binding", message=text)])
    binding, mistakes = checked(source.data or {}, Binding, _binding_mistakes)
    if binding is None or mistakes:
        raise ModelError([_problem(source, path, message) for path, message in mistakes])
    return binding


def _problem(source: Source, path: Path, message: str) -> Problem:
    subject = ".".join(map(str, path)) or "file"
    return Problem(file=source.file, line=source.line(path), subject=subject, rule="binding", message=message)


def _binding_mistakes(binding: Binding) -> Iterator[Mistake]:
    if bool(binding.pick) != bool(binding.drop):
        lacking, given = ("pick", "drop") if binding.drop else ("drop", "pick")
        yield (lacking,), f"is missing: a robot that carries things has `{given}` and `{lacking}`"
    if binding.charge is not None and "Charge" not in binding.attributes:
        hint = nearest("Charge", binding.attributes)
        similar = next((name for name in binding.attributes if name in hint.replace("?", "").split()), None)
        text = f"it is written {similar}" if similar is not None else "write the topic with the charge of the battery"
        yield ("attributes", similar or "Charge"), f"`charge` ends by the attribute Charge, which is not bound: {text}"
    if binding.pose is not None and "transform" in binding.model_fields_set:
        yield ("transform",), "is not read, because there is a `pose`: keep one of the two"
    if binding.pose is not None and POSES.get(binding.pose.type, binding.pose.field) != binding.pose.field:
        field = POSES[binding.pose.type]
        yield ("pose", "field"), f"the pose in {binding.pose.type} is {field or 'the message itself'}: write field: {field or chr(39) * 2}"
    yield from unknown_names(binding.navigate.goal, POSE_NAMES | AROUND_CORNERS | {"robot"}, ("navigate", "goal"))
    if binding.speed_limit is not None:
        yield from unknown_names(binding.speed_limit.message, frozenset({"speed"}), ("speed_limit", "message"))
    carrying = POSE_NAMES | {"robot", "thing", "support"}
    yield from unknown_in_steps(binding.pick, carrying, ("pick",))
    yield from unknown_in_steps(binding.drop, carrying, ("drop",))
    if binding.put_down is not None:
        yield from unknown_in_steps(binding.put_down.steps, carrying, ("put_down", "steps"))
    if binding.charge is not None:
        yield from unknown_in_steps(binding.charge.begin, POSE_NAMES | {"robot", "charger"}, ("charge", "begin"))
        yield from unknown_in_steps(binding.charge.end, POSE_NAMES | {"robot", "charger"}, ("charge", "end"))
