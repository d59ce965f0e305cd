"""The devices that `simulate` plays, out of its arguments."""

import argparse
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final, NamedTuple

from gateway.cli.kit.usage import WrongUsageError
from gateway.config.machine.profile_folders import OWN_PROFILES, file_of
from gateway.config.problem import did_you_mean, errors_in
from gateway.config.values.unitset import show_units
from gateway.registers.items import has_bits
from gateway.simulator.device import Device, Mode
from gateway.simulator.faults import Faults
from gateway.simulator.kinds import KINDS
from gateway.simulator.profiled import Kind, Profiled
from gateway.simulator.weigher import PRINTED_WEIGHT, Weigher

_WEIGHT: Final = "weight"


class Setting(NamedTuple):
    """A fixed value: of one unit, or of all that have such a point."""

    unit: int | None
    point: str
    text: str


class Group(NamedTuple):
    """Devices of one kind. Those in KINDS are as their documents say, unless a config has another kind of that name."""

    name: str
    units: tuple[int, ...]
    kind: Kind | None = None

    @property
    def mode(self) -> Mode | None:
        """The only mode of such a device, if it has only one."""
        if self.kind is not None:
            return self.kind.mode
        modes = KINDS[self.name].modes
        return next(iter(modes)) if len(modes) == 1 else None


def find_groups(wanted: Iterable[tuple[str, tuple[int, ...]]], config: Path | None) -> list[Group]:
    """Find the kinds of devices that the arguments name."""
    return [Group(name, units, _kind(name, config)) for name, units in wanted]


def make_devices(groups: Sequence[Group], args: argparse.Namespace) -> list[Device]:
    """Make the devices of groups, as the arguments say.

    Raises:
        WrongUsageError: they cannot be on one line, or have no such unit or point.
        ValueError: a point cannot hold its value.
    """
    units = [unit for group in groups for unit in group.units]
    for unit in units:
        if units.count(unit) > 1:
            raise WrongUsageError(
                f"two devices have the address {unit}", "--fault duplicate-address does that on purpose"
            )
    set_units = [setting.unit for setting in args.set if setting.unit is not None]
    for named in (*args.silent_unit, *args.moving_unit, *set_units):
        if named not in units:
            raise WrongUsageError(f"there is no unit {named} on this line; it has {show_units(units)}")
    taken = set[Setting]()
    devices = [_device(group, unit, args, taken) for group in groups for unit in group.units]
    for setting in args.set:
        if setting not in taken:
            points = [point.name for group in groups for point in _described(group).points]
            raise WrongUsageError(f'no device has a point "{setting.point}"', did_you_mean(setting.point, points))
    return devices


def _device(group: Group, unit: int, args: argparse.Namespace, taken: set[Setting]) -> Device:
    faults = Faults(silent=args.silent or unit in args.silent_unit, slow=args.slow, noise=args.noise)
    settings = _settings_of(group, unit, args.set, taken)
    if group.kind is not None:
        return Profiled(unit, group.kind, settings, seed=args.seed, baud=args.baud, faults=faults)
    if group.name == "weigher":
        weight = PRINTED_WEIGHT if args.weight is None else args.weight
        moves = (args.weight is None or unit in args.moving_unit) and _WEIGHT not in settings
        return Weigher(unit, weight=_weight(settings, weight), moves=moves, baud=args.baud, faults=faults)
    device = KINDS[group.name](unit, baud=args.baud, faults=faults)
    points = {point.name: point for point in _described(group).points} if settings else {}
    for name, text in settings.items():
        point = points[name]
        items = point.items(text)
        if has_bits(point.area):
            device.tables[point.area].assign(point.address, items)
        else:
            device.tables[point.area].write(point.span, items)
    return device


def _settings_of(group: Group, unit: int, settings: Sequence[Setting], taken: set[Setting]) -> dict[str, str]:
    """Choose what is set of one device, and add it to `taken`."""
    if not settings:
        return {}
    names = {point.name for point in _described(group).points}
    own = [each for each in settings if each.unit in (None, unit) and each.point in names]
    taken.update(own)
    return {each.point: each.text for each in own}


def _weight(settings: dict[str, str], weight: float) -> float:
    for name, text in settings.items():
        if name != _WEIGHT:
            raise WrongUsageError(f"{name} of a weigher cannot be set", "its document says what it is; weight can")
        try:
            weight = float(text)
        except ValueError:
            raise WrongUsageError(f'"{text}" is no weight', "write a number such as 12.5") from None
    return weight


def _described(group: Group) -> Kind:
    """Find the points of a group."""
    return group.kind or _load(group.name, None)[0]


def _kind(name: str, config: Path | None) -> Kind | None:
    if name in KINDS and config is None and file_of(name, OWN_PROFILES) is None:
        return None
    kind, is_shipped = _load(name, config)
    return None if name in KINDS and is_shipped else kind


def _load(name: str, config: Path | None) -> tuple[Kind, bool]:
    """Load a profile, and tell whether it is shipped. What does so takes long to import; KINDS do not need it."""
    from gateway.cli.profiles.known import BrokenFileError, Profiles  # noqa: PLC0415
    from gateway.config.reading.profile_file import SHIPPED  # noqa: PLC0415
    from gateway.simulator.described import kind_of  # noqa: PLC0415

    try:
        table = Profiles(config).get(name).table
    except BrokenFileError as broken:
        raise WrongUsageError("\n".join(errors_in(broken.problems))) from None
    return kind_of(name, table), table.place == SHIPPED
