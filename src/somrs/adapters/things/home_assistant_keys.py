"""The abbreviated keys of Home Assistant's discovery messages, as far as they are used (home-assistant.io, "MQTT", "Abbreviations")."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

ABBREVIATIONS = {
    "avty": "availability",
    "avty_mode": "availability_mode",
    "avty_t": "availability_topic",
    "avty_tpl": "availability_template",
    "bri_cmd_t": "brightness_command_topic",
    "bri_cmd_tpl": "brightness_command_template",
    "bri_scl": "brightness_scale",
    "bri_stat_t": "brightness_state_topic",
    "bri_val_tpl": "brightness_value_template",
    "cmd_t": "command_topic",
    "cmd_tpl": "command_template",
    "cmps": "components",
    "curr_temp_t": "current_temperature_topic",
    "curr_temp_tpl": "current_temperature_template",
    "dev": "device",
    "dev_cla": "device_class",
    "exp_aft": "expire_after",
    "mode_cmd_t": "mode_command_topic",
    "mode_cmd_tpl": "mode_command_template",
    "mode_stat_t": "mode_state_topic",
    "mode_stat_tpl": "mode_state_template",
    "o": "origin",
    "obj_id": "object_id",
    "off_dly": "off_delay",
    "opt": "optimistic",
    "p": "platform",
    "pl": "payload",
    "pl_avail": "payload_available",
    "pl_cls": "payload_close",
    "pl_lock": "payload_lock",
    "pl_not_avail": "payload_not_available",
    "pl_off": "payload_off",
    "pl_on": "payload_on",
    "pl_open": "payload_open",
    "pl_unlk": "payload_unlock",
    "pos_clsd": "position_closed",
    "pos_open": "position_open",
    "pos_t": "position_topic",
    "pos_tpl": "position_template",
    "ret": "retain",
    "set_pos_t": "set_position_topic",
    "set_pos_tpl": "set_position_template",
    "stat_clsd": "state_closed",
    "stat_closing": "state_closing",
    "stat_stopped": "state_stopped",
    "stat_locked": "state_locked",
    "stat_off": "state_off",
    "stat_on": "state_on",
    "stat_open": "state_open",
    "stat_opening": "state_opening",
    "stat_t": "state_topic",
    "stat_unlocked": "state_unlocked",
    "stat_val_tpl": "state_value_template",
    "sup_clrm": "supported_color_modes",
    "t": "topic",
    "temp_cmd_t": "temperature_command_topic",
    "temp_cmd_tpl": "temperature_command_template",
    "temp_stat_t": "temperature_state_topic",
    "temp_stat_tpl": "temperature_state_template",
    "temp_unit": "temperature_unit",
    "uniq_id": "unique_id",
    "unit_of_meas": "unit_of_measurement",
    "val_tpl": "value_template",
}
DEVICE_ABBREVIATIONS = {"cns": "connections", "ids": "identifiers", "mf": "manufacturer", "mdl": "model", "sa": "suggested_area"}


def full_keys(config: Mapping[str, Any]) -> dict[str, Any]:
    """The message with its keys written out, and `~` in topics replaced by the base topic."""
    full = {ABBREVIATIONS.get(key, key): value for key, value in config.items()}
    base_topic = full.pop("~", None)
    if isinstance(base_topic, str):
        full = {key: _with_base(value, base_topic) if key.endswith("topic") else value for key, value in full.items()}
    if isinstance(device := full.get("device"), dict):
        full["device"] = {DEVICE_ABBREVIATIONS.get(key, key): value for key, value in device.items()}
    if isinstance(entries := full.get("availability"), list):
        written = [{ABBREVIATIONS.get(key, key): value for key, value in entry.items()} for entry in entries if isinstance(entry, dict)]
        if isinstance(base_topic, str):
            written = [{**entry, "topic": _with_base(entry.get("topic"), base_topic)} for entry in written]
        full["availability"] = written
    return full


def _with_base(topic: Any, base_topic: str) -> Any:
    if not isinstance(topic, str):
        return topic
    if topic.startswith("~"):
        return f"{base_topic}{topic[1:]}"
    return f"{topic[:-1]}{base_topic}" if topic.endswith("~") else topic
