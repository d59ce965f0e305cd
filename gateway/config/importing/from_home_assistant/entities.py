"""Entities of Home Assistant as points: as far as they are registers and coils."""

from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final, NamedTuple

from gateway.config.importing.from_home_assistant.fields import Fields, whole
from gateway.config.importing.from_home_assistant.layout import Layout, layout_of
from gateway.config.importing.imported import ImportedFileError
from gateway.config.importing.points import plain
from gateway.config.importing.yaml_text import plain_text
from gateway.config.reading.toml_text import Value
from gateway.modbus.codes import Area

#: The area of each `input_type` and `write_type`; the plural means functions 15 and 16.
_AREAS: Final[Mapping[str, Area]] = {
    "holding": Area.HOLDING,
    "holdings": Area.HOLDING,
    "input": Area.INPUT,
    "coil": Area.COILS,
    "coils": Area.COILS,
    "discrete_input": Area.DISCRETE,
    "discrete": Area.DISCRETE,
}
REGISTERS: Final = (Area.HOLDING, Area.INPUT)
#: Home Assistant lets a light be 0 to 100 % bright, and takes this number for none.
_BRIGHTNESS: Final[Mapping[str, Value]] = {"unit": "%", "invalid": 0xFFFF, "min": 0, "max": 100}
_MOST_VIRTUAL: Final = 2000
_NOT_READ_BACK: Final = "Home Assistant did not read it (no verify); with write = true it is read too"


class Found(NamedTuple):
    """A point of an entity: what stands behind the entity's name, its keys, and what is said of it."""

    suffix: str
    keys: dict[str, Value]
    remark: str = ""


def sensor(fields: Fields) -> Iterator[Found]:
    """Make the points of a sensor: one for each value in its registers."""
    area, address, layout = (
        area_in(fields, "input_type", Area.HOLDING, REGISTERS),
        fields.whole("address"),
        layout_of(fields),
    )
    meaning = meaning_of(fields, "scale", "offset") | _unit(fields.text("unit_of_measurement", "").strip())
    nan = fields.value("nan_value")
    if nan is not None:
        meaning |= {"invalid": _raw(nan)}
    remark = _clamped(fields)
    several = _virtual(fields) if len(layout.parts) == 1 else 0
    for virtual in range(several + 1):
        for index, part in enumerate(layout.parts):
            number = virtual + index
            at = address + virtual * layout.registers + part.register
            is_text = part.keys.get("type") == "string"
            yield Found(f"-{number}" if number else "", {area: at} | part.keys | ({} if is_text else meaning), remark)


def binary_sensor(fields: Fields) -> Iterator[Found]:
    """Make the points of a binary sensor: coils, inputs, or the lowest bits of registers."""
    area, address = area_in(fields, "input_type", Area.COILS, tuple(Area)), fields.whole("address")
    bit: dict[str, Value] = {"bit": 0} if area in REGISTERS else {}
    for virtual in range(_virtual(fields) + 1):
        yield Found(f"-{virtual}" if virtual else "", {area: address + virtual} | bit)


def switch(fields: Fields) -> Iterator[Found]:
    """Make the points of a switch, a light or a fan: what is commanded, and what is read back if that is elsewhere."""
    write_type, address = fields.text("write_type", "holding"), fields.whole("address")
    area = area_in(fields, "write_type", Area.HOLDING, (Area.HOLDING, Area.COILS))
    on, off = fields.whole("command_on", 1), fields.whole("command_off", 0)
    commands = labelled(area, {"on": [on], "off": [off]})
    command = writing_keys(is_plural=write_type.endswith("s"))
    if not fields.has("verify"):
        yield Found("", {area: address} | commands | command | {"write": "only"}, _NOT_READ_BACK)
    else:
        verify = fields.part("verify")
        yield from (
            _verified(verify, area, address, (on, off), command)
            if verify
            else (Found("", {area: address} | commands | command),)
        )
    for key, name in (("brightness_address", "brightness"), ("color_temp_address", "color-temperature")):
        if fields.has(key):
            yield Found(f"-{name}", {Area.HOLDING: fields.whole(key)} | dict(_BRIGHTNESS) | {"write": True})


def cover(fields: Fields) -> Iterator[Found]:
    """Make the points of a cover: its command, and its state if that is elsewhere."""
    area = area_in(fields, "input_type", Area.HOLDING, (Area.HOLDING, Area.COILS))
    address = fields.whole("address")
    usual = {"closed": 0, "open": 1, "opening": 2, "closing": 3}
    states = {state: [fields.whole(f"state_{state}", number)] for state, number in usual.items()}
    ends = states if area is Area.HOLDING else {"closed": [0], "open": [1]}
    if not fields.has("status_register"):
        yield Found("", {area: address} | labelled(area, ends) | writing_keys())
        return
    status = area_in(fields, "status_register_type", Area.HOLDING, REGISTERS)
    yield Found("", {status: fields.whole("status_register")} | labelled(status, states))
    commands = {state: ends[state] for state in ("open", "closed")}
    yield Found("-command", {area: address} | labelled(area, commands) | writing_keys() | {"write": "only"})


def _verified(
    verify: Fields, area: Area, address: int, commands: tuple[int, int], command: dict[str, Value]
) -> Iterator[Found]:
    """Make one point if what is read back is what is written, at another address perhaps; else one for each."""
    at, read = verify.whole("address", address), area_in(verify, "input_type", area, tuple(Area))
    on, off = (_numbers(verify, key, usual) for key, usual in (("state_on", commands[0]), ("state_off", commands[1])))
    states = labelled(read, {"on": on, "off": off})
    if read is area and (on, off) == ([commands[0]], [commands[1]]):
        yield Found("", {area: at} | states | command | ({} if at == address else {"write_at": address}))
        return
    yield Found("", {read: at} | states)
    labels = labelled(area, {"on": [commands[0]], "off": [commands[1]]})
    yield Found("-command", {area: address} | labels | command | {"write": "only"})


def _numbers(fields: Fields, key: str, usual: int) -> list[int]:
    return [whole(each, key) for each in fields.rows(key)] or [usual]


def labelled(area: Area, texts: Mapping[str, list[int]]) -> dict[str, Value]:
    """Make labels. A text that several numbers have gets the number behind it; on and off of a bit need none."""
    labels: dict[str, Value] = {}
    for text, numbers in texts.items():
        for index, number in enumerate(numbers):
            labels.setdefault(str(number), f"{text} ({number})" if index else text)
    is_plain = area not in REGISTERS and (labels.get("1"), labels.get("0")) == ("on", "off")
    return {} if is_plain or not labels else {"labels": labels}


def writing_keys(*, is_plural: bool = False) -> dict[str, Value]:
    """Make the keys for a point that is written, with `is_plural` by functions 15 and 16."""
    return {"write": True, "write_function": "multiple"} if is_plural else {"write": True}


def area_in(fields: Fields, key: str, usual: Area, known: tuple[Area, ...]) -> Area:
    """Return the area that a key names."""
    text = fields.text(key, "")
    area = _AREAS.get(text) if text else usual
    if area not in known:
        raise ImportedFileError(f"{key} {text} is not possible here")
    return area


def meaning_of(fields: Fields, scale_key: str, offset_key: str) -> dict[str, Value]:
    """Make the keys for scale, offset and decimals; those for one temperature stand in place of those for both."""
    scale = fields.number(scale_key) or fields.number("scale")
    offset = fields.number(offset_key) or fields.number("offset")
    keys: dict[str, Value] = {} if scale is None or scale == 1 else {"scale": plain(scale)}
    keys |= {"offset": plain(offset)} if offset else {}
    return keys | ({"decimals": fields.whole("precision")} if fields.has("precision") else {})


def _unit(unit: str) -> dict[str, Value]:
    return {"unit": unit} if unit else {}


def _raw(value: Any) -> int:
    """Parse `nan_value`: a number, or text such as 0x8000."""
    text = plain_text(value).lower()
    try:
        return int(text, 16 if text.lstrip("-").startswith("0x") else 10)
    except ValueError:
        raise ImportedFileError("nan_value must be a number such as 0x8000") from None


def _virtual(fields: Fields) -> int:
    """Return how many more there are of the same kind, one behind the other."""
    count = fields.whole("virtual_count", fields.whole("slave_count", 0))
    if count > _MOST_VIRTUAL:
        raise ImportedFileError(f"virtual_count is at most {_MOST_VIRTUAL}")
    return count


def _clamped(fields: Fields) -> str:
    """Say what Home Assistant did with values that are out of bounds, which are published here as they are."""
    said = [
        f"{what} {number:f}"
        for key, what in (("min_value", "raised to"), ("max_value", "lowered to"), ("zero_suppress", "made 0 up to"))
        if (number := fields.number(key)) is not None
    ]
    return f"Home Assistant: values beyond were {', '.join(said)}; here they are as the device has them" if said else ""


def climate(fields: Fields) -> Iterator[Found]:
    """Make the points of a thermostat: its temperatures, modes and switches."""
    area, address = area_in(fields, "input_type", Area.HOLDING, REGISTERS), fields.whole("address")
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


#: The entities of each key of a connection, and how one of them becomes points.
KINDS: Final[Mapping[str, tuple[str, Callable[[Fields], Iterator[Found]]]]] = {
    "sensors": ("sensor", sensor),
    "binary_sensors": ("binary sensor", binary_sensor),
    "switches": ("switch", switch),
    "lights": ("light", switch),
    "fans": ("fan", switch),
    "covers": ("cover", cover),
    "climates": ("climate", climate),
}
