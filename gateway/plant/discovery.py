"""Discovery by Home Assistant: which devices there are, and how to read, show and set each of their points.

One retained message for each device describes all of its points ("device discovery"). The names of keys, platforms and
device classes, and which units belong to a device class, are Home Assistant's own.
"""

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from typing import Any, Final
from zlib import crc32

from gateway.plant.messages import Message
from gateway.plant.topics import Topics
from gateway.profiles.point import Point
from gateway.profiles.published import PublishedDevice, PublishedPoint
from gateway.registers.datatypes import is_float
from gateway.version import __version__

#: The platform of each component of each device that was announced, by the topic of the device and the component's key.
Announced = Mapping[str, Mapping[str, str]]

_Config = dict[str, Any]

_ON: Final = "1"
_OFF: Final = "0"
#: The value that means "unknown" to Home Assistant.
_UNKNOWN: Final = "None"
#: Home Assistant accepts no finer step.
_SMALLEST_STEP: Final = 0.001
_GREATEST_FLOAT32: Final = 3.4e38

#: Spellings of units that Home Assistant writes in another way.
_SPELLINGS: Final[Mapping[str, str]] = {
    "degC": "°C",
    "degF": "°F",
    "m2": "m²",
    "m3": "m³",
    "m3/h": "m³/h",
    "m3/min": "m³/min",
    "m3/s": "m³/s",
    "l": "L",
    "l/h": "L/h",
    "l/min": "L/min",
    "l/s": "L/s",
    "ml": "mL",
    "mVAr": "mvar",
    "VAr": "var",
    "kVAr": "kvar",
    "VArh": "varh",
    "kVArh": "kvarh",
    "W/m2": "W/m²",
    "1/min": "rpm",
    "Lux": "lx",
    "lux": "lx",
}
_MICRO_SIGN, _GREEK_MU = "µ", "μ"

#: Device classes by unit. Units that may mean several things (%, K, dB, m³, ppm) have none: users choose it there.
_CLASSES: Final[Mapping[str, str]] = {
    unit: device_class
    for device_class, units in {
        "apparent_power": "mVA VA kVA",
        "area": "mm² cm² m² km² ha",
        "conductivity": "μS/cm mS/cm S/cm",
        "current": "mA A",
        "distance": "mm cm m km",
        "duration": "μs ms s min h d",
        "energy": "mWh Wh kWh MWh GWh TWh J kJ MJ GJ",
        "frequency": "Hz kHz MHz GHz",
        "illuminance": "lx",
        "irradiance": "W/m²",
        "power": "mW W kW MW GW",
        "pressure": "Pa hPa kPa mbar cbar bar mmHg inHg psi",
        "reactive_energy": "varh kvarh",
        "reactive_power": "mvar var kvar",
        "signal_strength": "dBm",
        "sound_pressure": "dBA",
        "speed": "mm/s m/min m/s km/h mph kn",
        "temperature": "°C °F",
        "voltage": "μV mV V kV",
        "volume_flow_rate": "m³/h m³/min m³/s L/h L/min L/s mL/s",
        "weight": "μg mg g kg lb",
    }.items()
    for unit in units.split()
}
_COUNTED: Final = ("energy", "reactive_energy")


@dataclass(frozen=True, slots=True)
class Discovery:
    """Announces the devices of a site to Home Assistant, which listens below `prefix`."""

    topics: Topics
    prefix: str

    @property
    def folder(self) -> str:
        """The part that all topics of the site have in common, whatever the prefix."""
        return f"/device/{_identifier(self.topics.site)}/"

    def messages(self, devices: Sequence[PublishedDevice], before: Announced) -> Sequence[Message]:
        """Make the messages that announce `devices`, and remove obsolete components that were announced `before`."""
        return [message for device in devices for message in self._announce(device, before)]

    def announced(self, devices: Iterable[PublishedDevice]) -> Announced:
        """Return what `messages` announces: the argument `before` of its next call."""
        return {
            self._topic(device): {key: component["p"] for key, component in self._components(device).items()}
            for device in devices
        }

    def _announce(self, device: PublishedDevice, before: Announced) -> Iterable[Message]:
        topic, components = self._topic(device), self._components(device)
        # A component is removed by its platform alone; one with another platform is another component.
        removed = {
            key: {"p": platform}
            for key, platform in before.get(topic, {}).items()
            if key not in components or components[key]["p"] != platform
        }
        if removed:
            yield _message(topic, self._config(device, components | removed))
        yield _message(topic, self._config(device, components))

    def _topic(self, device: PublishedDevice) -> str:
        return f"{self.prefix}{self.folder}{_identifier(device.name)}/config"

    def _config(self, device: PublishedDevice, components: Mapping[str, _Config]) -> _Config:
        """Make the description of a device for Home Assistant."""
        maker = {"mf": device.maker} if device.maker else {}
        return {
            "dev": {"ids": [self._id(device.name)], "name": device.name, "mdl": device.profile, **maker},
            "o": {"name": "modbus-gateway", "sw": __version__},
            "avty": [{"t": self.topics.status}, {"t": self.topics.availability(device.name)}],
            "avty_mode": "all",
            "stat_t": self.topics.values(device.name),
            "qos": 1,
            "cmps": components,
        }

    def _components(self, device: PublishedDevice) -> dict[str, _Config]:
        """Make the components for the points that can be read, or written from the broker, by names of points."""
        return {
            point.name: self._component(device, point)
            for point in device.points
            if point.is_readable or point.is_writable
        }

    def _component(self, device: PublishedDevice, published: PublishedPoint) -> _Config:
        point = published.point
        named = {"name": point.name, "uniq_id": self._id(device.name, point.name)}
        command = {"cmd_t": self.topics.setting(device.name, point.name)}
        if point.write == "only" and len(point.labels) == 1:
            return named | command | {"p": "button", "pl_prs": next(iter(point.labels.values()))}
        shared = named | {
            "val_tpl": f"{{{{ value_json['{point.name}'] | default('{_UNKNOWN}') }}}}",
        }
        if not published.is_writable:
            return shared | _sensor(point)
        return shared | command | _control(point)

    def _id(self, *names: str) -> str:
        """Make an identifier that is unique in Home Assistant, as long as sites have different names."""
        return "/".join(("modbus", self.topics.site, *names))


def _sensor(point: Point) -> _Config:
    """Make a component that shows the point."""
    if point.is_bit and not point.labels:
        return {"p": "binary_sensor", "pl_on": _ON, "pl_off": _OFF}
    if point.is_bit:
        return {"p": "sensor", "dev_cla": "enum", "ops": [point.labels.get(bit, str(bit)) for bit in (0, 1)]}
    if point.labels or point.type == "string":
        # No `options`: a number without a label would leave the label before it on the display.
        return {"p": "sensor"}
    return {"p": "sensor", "stat_cla": _state_class(point)} | _unit(point) | _precision(point)


def _control(point: Point) -> _Config:
    """Make a component that shows and sets the point."""
    if point.type == "string":
        shown = f"{{{{ value_json['{point.name}'] | default('', true) }}}}"
        return {"p": "text", "max": point.width * point.count, "val_tpl": shown}
    if point.labels:
        options = [point.labels.get(bit, str(bit)) for bit in (0, 1)] if point.is_bit else list(point.labels.values())
        return {"p": "select", "ops": options, "val_tpl": _chosen(point.name, options)}
    if point.is_bit:
        return {"p": "switch", "pl_on": _ON, "pl_off": _OFF}
    step, (least, greatest) = _step(point), _range(point)
    # A component whose ends are equal is refused, and all of its device with it.
    return {"p": "number", "min": least, "max": max(greatest, least + step), "step": step, "mode": "box"} | _unit(point)


def _chosen(name: str, options: Sequence[str]) -> str:
    """Make a template for the value of a point: unknown unless it is one of the options."""
    known = json.dumps(options, ensure_ascii=False)
    return (
        f"{{% set value = value_json['{name}'] | default('') %}}{{{{ value if value in {known} else '{_UNKNOWN}' }}}}"
    )


def _unit(point: Point) -> _Config:
    """Return the keys of the unit in Home Assistant's spelling and of its device class, if it has them."""
    if point.unit == "pH":
        return {"dev_cla": "ph"}
    unit = _spelled(point.unit)
    if not unit:
        return {}
    device_class = _CLASSES.get(unit)
    return {"unit_of_meas": unit} | ({"dev_cla": device_class} if device_class else {})


def _spelled(unit: str) -> str:
    """Spell a unit as Home Assistant does."""
    return _SPELLINGS.get(unit, unit).replace(_MICRO_SIGN, _GREEK_MU)


def _state_class(point: Point) -> str:
    """Choose the statistics that are kept: of a value, of a counter, or of one that may also count down."""
    if _CLASSES.get(_spelled(point.unit)) not in _COUNTED:
        return "measurement"
    return "total" if point.type.startswith("int") else "total_increasing"


def _precision(point: Point) -> _Config:
    return {} if point.decimals is None else {"sug_dsp_prc": point.decimals}


def _range(point: Point) -> tuple[float, float]:
    """Return the least and the greatest value that can be written to the point."""
    least, greatest = -_GREATEST_FLOAT32, _GREATEST_FLOAT32
    if not is_float(point.type) and point.scale_at is None:
        scale, offset = Decimal(repr(point.scale)), Decimal(repr(point.offset))
        least, greatest = sorted(float(bound * scale + offset) for bound in point.least_and_greatest)
    least = least if point.minimum is None else max(least, point.minimum)
    return least, greatest if point.maximum is None else min(greatest, point.maximum)


def _step(point: Point) -> float:
    """Return the least change of the value that can be set."""
    if is_float(point.type) or point.scale_at is not None:
        return max(_SMALLEST_STEP, 10.0**-point.decimals) if point.decimals is not None else _SMALLEST_STEP
    return max(_SMALLEST_STEP, abs(point.scale))


def _identifier(name: str) -> str:
    """Replace characters that a discovery topic may not have; different names remain different."""
    allowed = re.sub(r"[^a-zA-Z0-9_-]", "_", name)
    return allowed if allowed == name else f"{allowed}-{crc32(name.encode()):08x}"


def _message(topic: str, config: _Config) -> Message:
    return Message(topic, json.dumps(config, ensure_ascii=False, separators=(",", ":")).encode(), retain=True)
