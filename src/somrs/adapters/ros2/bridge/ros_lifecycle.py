"""The life cycle of a node: the nodes of Nav2 are there before they are active, and reject goals until then."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from somrs.adapters.ros2.bridge.ros_values import interface
else:
    from ros_values import interface

ASKED = 1.0
"""How often a node is asked for its state, s."""
REPEATED = 5.0
"""After which time it is asked again if it does not answer: a request to a node that is new can get lost. Seconds."""
TYPE = "lifecycle_msgs/srv/GetState"
LABELS = {1: "unconfigured", 2: "inactive", 3: "active", 4: "finalized"}
"""lifecycle_msgs/msg/State; others are transitions."""


class Lifecycle:
    """The state of the node that has an endpoint. A node without a life cycle counts as active."""

    def __init__(self, node: Any) -> None:
        self.node = node
        self.client: Any = None
        self.is_managed: bool | None = None
        """Whether the node has a life cycle; None: this is not known yet."""
        self.label: str | None = None
        self.asked = self.answered = -math.inf

    def forget(self) -> None:
        """From now on, it is another node."""
        if self.client is not None:
            self.node.destroy_client(self.client)
        self.client, self.is_managed, self.label = None, None, None
        self.asked = self.answered = -math.inf

    def state(self, endpoint: Any) -> str | None:
        """The name of its state; None if it is not known. Asks for it. `endpoint`: as `get_publishers_info_by_topic` has it, at first
        without the name of its node."""
        if self.is_managed is None:
            self.find(endpoint.node_name, endpoint.node_namespace)
        if self.is_managed is False:
            return "active"
        if self.client is not None:
            self.ask()
        return self.label

    def find(self, name: str, namespace: str) -> None:
        try:
            services = self.node.get_service_names_and_types_by_node(name, namespace)
        except RuntimeError:  # NodeNameNonExistentError is one
            return  # what is known of the node has not come yet
        service = next((service for service, types in services if TYPE in types and service.endswith("/get_state")), None)
        self.is_managed = service is not None
        if service is not None:
            self.client = self.node.create_client(interface(TYPE, "srv"), service)

    def ask(self) -> None:
        now = time.monotonic()
        is_waiting = self.asked > self.answered
        if now < self.asked + (REPEATED if is_waiting else ASKED) or not self.client.service_is_ready():
            return
        self.asked = now
        client = self.client
        request = interface(TYPE, "srv").Request()
        client.call_async(request).add_done_callback(lambda done: self.take(client, done.result()))

    def take(self, client: Any, response: Any) -> None:
        if client is self.client and response is not None:
            self.answered = time.monotonic()
            self.label = LABELS.get(response.current_state.id, response.current_state.label or "changing its state")
