"""Thermostats of Home Assistant as points."""

from collections.abc import Iterator

from gateway.config.importing.from_home_assistant.entities import (
    REGISTERS,
    Found,
    area_in,
    labelled,
    meaning_of,
    writing_keys,
)
from gateway.config.importing.from_home_assistant.fields import Fields, whole
from gateway.config.importing.from_home_assistant.layout import Layout, layout_of
from gateway.config.importing.imported import ImportedFileError
from gateway.config.importing.points import plain
from gateway.config.reading.toml_text import Value
from gateway.modbus.codes import Area


def climate(fields: Fields) -> Iterator[Found]:
    """Make the points of a thermostat: its temperatures, modes and switches."""
    key, kind = ("address", "input_type")
    if not fields.has(key):  # before 2021.5
        key, kind = ("current_temp_register", "current_temp_register_type")
    area, address = area_in(fields, kind, Area.HOLDING, REGISTERS), fields.whole(key)
    layout = layout_of(fields)
    unit: dict[str, Value] = {"unit": "°F" if fields.text("temperature_unit", "C").upper() == "F" else "°C"}
    current = layout.parts[0]
    meaning = meaning_of(fields, "current_temp_scale", "current_temp_offset")
    yield Found("-temperature", {area: address + current.register} | current.keys | meaning | unit)
    yield from _setpoints(fields, layout, unit)
    yield from _modes(fields)


def _setpoints(fields: Fields, layout: Layout, unit: dict[str, Value]) -> Iterator[Found]:
    """Make a point for the setpoint, or for each of several modes that have one of their own."""
    keys = layout.parts[0].keys | meaning_of(fields, "target_temp_scale", "target_temp_offset") | unit
    for key, bound in (("min", "min_temp"), ("max", "max_temp")):
        limit = fields.number(bound)
        keys |= {} if limit is None else {key: plain(limit)}
    keys |= writing_keys(is_plural=fields.truth("target_temp_write_registers") and layout.registers == 1)
    modes = ("auto", "cool", "dry", "fan-only", "heat", "heat-cool", "off")
    registers = [whole(each, "target_temp_register") for each in fields.rows("target_temp_register")]
    if len(set(registers)) == 1:
        yield Found("-setpoint", {Area.HOLDING: registers[0]} | keys)
        return
    if len(registers) != len(modes):
        raise ImportedFileError("target_temp_register must be one register, or one for each of seven modes")
    for register in dict.fromkeys(registers):
        mode = modes[registers.index(register)]
        yield Found(f"-setpoint-{mode}", {Area.HOLDING: register} | keys)


def _modes(fields: Fields) -> Iterator[Found]:
    """Make the points for the modes of a thermostat."""
    if fields.has("hvac_onoff_coil"):
        yield Found("-on", {Area.COILS: fields.whole("hvac_onoff_coil")} | writing_keys())
    if fields.has("hvac_onoff_register"):
        labels = {"on": [fields.whole("hvac_on_value", 1)], "off": [fields.whole("hvac_off_value", 0)]}
        writing = writing_keys(is_plural=fields.truth("write_registers"))
        register = fields.whole("hvac_onoff_register")
        yield Found("-on", {Area.HOLDING: register} | labelled(Area.HOLDING, labels) | writing)
    for key, name, prefix in (
        ("hvac_mode_register", "mode", "state_"),
        ("fan_mode_register", "fan", "state_fan_"),
        ("swing_mode_register", "swing", "swing_mode_state_"),
        ("hvac_action_register", "action", "action_"),
    ):
        table = fields.part(key)
        if table is not None:
            yield Found(f"-{name}", _mode(table, prefix, can_write=name != "action"))


def _mode(table: Fields, prefix: str, *, can_write: bool) -> dict[str, Value]:
    """Make the keys for a register whose numbers are modes. An address in a list is written with function 16."""
    area = area_in(table, "input_type", Area.HOLDING, REGISTERS)
    (address,) = table.rows("address")[:1] or [None]
    values = table.part("values")
    modes = {
        mode.removeprefix(prefix): [whole(each, mode) for each in (numbers if isinstance(numbers, list) else [numbers])]
        for mode, numbers in (values.items() if values else [])
    }
    is_plural = isinstance(table.value("address"), list) or table.truth("write_registers")
    writing = writing_keys(is_plural=is_plural) if can_write else {}
    return {area: whole(address, "address")} | labelled(area, modes) | writing
