"""The accounts of the NATS servers of a bus: one of the components, and one of who speaks MQTT.

Accounts are worlds of their own: whatever topic a thing names, no message and no stream of the components has it. A certificate with topics
is a user of the account of MQTT; each certificate but those of things is one of the components' account.
"""

from __future__ import annotations

from collections.abc import Iterable

from somrs.limits import limits
from somrs.runtime.bus_rights import permissions
from somrs.trust.holders import Holder
from somrs.trust.identity import Identity, Role, certificate_uri, mqtt_uri
from somrs.trust.mqtt_topics import subjects_of

COMPONENTS, MQTT = "somrs", "mqtt"
"""The names of the accounts; without certificates, also those of the users of which everybody is one."""

_QUALITY_1 = "$MQTT.sub.>"
"""Where the server sends an MQTT client the messages of its subscriptions with quality of service 1 and 2. It refuses clients' own
subscriptions to this."""

_INTERNAL = [f"${name}.>" for name in ("MQTT", "JS", "KV", "O", "SYS", "SRV")]
"""Subjects by which the account itself is changed; the topics of MQTT that begin with `$` are not for clients (3.1.1, 4.7.2)."""


def users_of(holders: Iterable[Holder], sites: Iterable[str]) -> tuple[list[dict[str, object]], list[dict[str, object]]]:
    """The users of both accounts, as in the configuration of a NATS server: components, and who speaks MQTT. `sites`: as of `permissions`.

    The names of users have the serial number of their certificate: who is revoked and enrolled again cannot use the earlier one.
    """
    components: list[dict[str, object]] = []
    mqtt: list[dict[str, object]] = []
    sites = [*sites]
    for holder in holders:
        identity = holder.identity
        if identity.roles - {Role.THING}:
            components.append(_user(certificate_uri(holder.serial), permissions(identity, sites), "STANDARD"))
        if identity.topics:
            mqtt.append(_user(mqtt_uri(holder.serial), mqtt_permissions(identity), "MQTT"))
    return components, mqtt


def mqtt_permissions(identity: Identity) -> dict[str, object]:
    """What an identity may do by MQTT: publish at its topics, and subscribe to them."""
    subjects = [subject for topics in sorted(identity.topics) for subject in subjects_of(topics)]
    return {"publish": {"allow": subjects, "deny": _INTERNAL}, "subscribe": [*subjects, _QUALITY_1]}


def accounts(components: list[dict[str, object]], mqtt: list[dict[str, object]]) -> dict[str, object]:
    """The part of the configuration with both accounts."""
    kept = {"max_file": limits().broker_bytes}
    return {"accounts": {COMPONENTS: {"jetstream": "enabled", "users": components}, MQTT: {"jetstream": kept, "users": mqtt}}}


def without_certificates() -> dict[str, object]:
    """The part of the configuration where nobody proves anything: who connects is in the account of its protocol."""
    components, mqtt = _user(COMPONENTS, {"publish": ">", "subscribe": ">"}, "STANDARD"), _user(MQTT, _EVERYTHING, "MQTT")
    return {**accounts([components], [mqtt]), "no_auth_user": COMPONENTS}


_EVERYTHING: dict[str, object] = {"publish": {"allow": [">"], "deny": _INTERNAL}, "subscribe": [">"]}


def _user(name: str, permissions: dict[str, object], connection: str) -> dict[str, object]:
    """A user, who connects by NATS (`STANDARD`) or by MQTT only."""
    return {"user": name, "permissions": permissions, "allowed_connection_types": [connection]}
