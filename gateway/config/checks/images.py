"""Cross-checks of `[[image]]`: images, mirrors, virtual units, units made in Python; and how often they read."""

from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import Final

from gateway.config.checks.maps import check_map
from gateway.config.checks.units import claims, profile_of_row
from gateway.config.plan.images import OWN_VALUES, kind_of
from gateway.config.plan.map_place import cannot_be_polled
from gateway.config.plan.names import device_names, heard_on, owners, rows_of
from gateway.config.plan.points import initial_values, ranges_in
from gateway.config.plan.reach import client_lines, units_without_devices
from gateway.config.problem import Path, Problem, did_you_mean, error, warning
from gateway.config.schema.config import Config
from gateway.config.schema.image import Image
from gateway.config.schema.profile import ProfileTable
from gateway.config.values.duration import show_duration
from gateway.config.values.ranges import show_ranges
from gateway.images.self_image import NAME
from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.profiles.profile import Range, covers

_NAME_CLASS: Final = 'name its class: python = "module:Name"'


def check_images(config: Config, failed: frozenset[str]) -> Iterator[Problem]:
    """Find images without the addresses of their initial values, and mirrors and rows of what cannot be polled.

    What rows ask of their devices is found in the settings that follow: see `maps`.
    """
    profiles = _profiles_of_devices(config)
    for image in config.image:
        kind = kind_of(image)
        if kind != "unit made in Python" and image.has("timeout"):
            yield error((*image.path, "timeout"), "only a unit made in Python has this key", _NAME_CLASS)
        if kind == "unit made in Python":
            yield from _check_made_in_python(image)
            yield from _check_own_registers(image, config.profile.get(image.profile))
        elif image.of is not None:
            yield from _check_mirror(image)
            if image.of not in profiles and not failed & {"line", "upstream"}:
                yield error(
                    (*image.path, "of"), f'there is no device "{image.of}"', _advise_on(image.of, config, profiles)
                )
            profile = profiles.get(image.of)
            if profile is not None:
                yield from _check_polled(image, image.of, profile)
        else:
            yield from _check_own_registers(image, config.profile.get(image.profile or ""))
            yield from check_map(image) if kind == "virtual unit" else _check_local(image)
    if not failed & {"line", "upstream", "image", "self"}:
        yield from _check_sources(config, profiles)


def _check_sources(config: Config, devices: Collection[str]) -> Iterator[Problem]:
    """Find rows of maps that name what is no device and no image."""
    others = {image.label: kind for image in config.image if (kind := kind_of(image)) not in OWN_VALUES}
    known = {*devices, *(image.label for image in config.image if image.label not in others)}
    known |= set() if config.own is None else {NAME}
    for image in config.image:
        unknown = {row.device: row for row in reversed(image.map) if row.device is not None and row.device not in known}
        for name, row in reversed(unknown.items()):
            what, remedy = f'there is no device "{name}"', _advise_on(name, config, known)
            if name in others:
                what, remedy = f'"{name}" is a {others[name]}, and rows read devices and images', "name its device"
            yield error((*row.path, "device"), what, remedy)


def _advise_on(name: str, config: Config, known: Iterable[str]) -> str:
    """Say which device may be meant by the name of one that does not exist."""
    return _owner_of(name, config) or _name_of_unit(name, config) or did_you_mean(name, known)


def _owner_of(name: str, config: Config) -> str:
    """Say why this unit of a line without devices does not pass through; empty if it does, or is no such unit."""
    lines = [line for line in client_lines(config) if line.devices is None]
    taken = ((claim, unit) for claim in claims(config) for unit in claim.units)
    found = (
        f"unit {unit} is {claim.owner}" for claim, unit in taken for line in lines if name == f"{line.label}/{unit}"
    )
    return next(found, "")


def _name_of_unit(text: str, config: Config) -> str:
    """Tell the name of a device of which the number is written instead; empty if there is no such unit."""
    named = (
        (str(unit), name) for claim in claims(config) for unit, name in zip(claim.units, claim.names, strict=False)
    )
    return next((f'write the name of unit {unit}: "{name}"' for unit, name in named if unit == text), "")


def _profiles_of_devices(config: Config) -> dict[str, ProfileTable | None]:
    """Find the profile of each device, by its name; None if it does not exist."""
    profiles: dict[str, ProfileTable | None] = {}
    for line in client_lines(config):
        if line.devices is None:
            names = (f"{line.label}/{unit}" for unit in units_without_devices(line, config))
            profiles |= dict.fromkeys(names, config.profile.get(line.profile))
    for owner in owners(config):
        for row in rows_of(owner):
            profiles |= dict.fromkeys(device_names(owner, row), profile_of_row(config, owner, row))
    return profiles


def _check_local(image: Image) -> Iterator[Problem]:
    remedies = {
        "read": ("only a mirror has this key", 'name the device to poll: of = "DEVICE"'),
        "stale": ("only mirrors and virtual units have this key", 'name the device to poll: of = "DEVICE"'),
        "when_stale": ("only a virtual unit has this key", "say what it consists of: map = [...]"),
    }
    for key in filter(image.has, remedies):
        yield error((*image.path, key), *remedies[key])
    if not any(ranges_in(area, image) for area in Area):
        yield error(image.path, "has no register and no coil", "write how many, such as holding = 100")


def _check_made_in_python(image: Image) -> Iterator[Problem]:
    for key in filter(image.has, ("of", "read", "stale", "map", "when_stale", "persist", "initial")):
        yield error((*image.path, key), "a unit made in Python has what its class says", "take the key out, or python")


def _check_own_registers(image: Image, profile: ProfileTable | None) -> Iterator[Problem]:
    if profile is not None and profile.wide:
        yield error((*image.path, "profile"), "an image has no registers of four bytes", "choose another profile")
    for area in Area:
        yield from _check_initial(image, area)


def _check_initial(image: Image, area: Area) -> Iterator[Problem]:
    ranges = ranges_in(area, image)
    for row in initial_values(area, image):
        span = Span(area, row.at, len(row.values))
        if not row.values:
            yield error((*row.path, "values"), "is empty")
        elif not covers(ranges, span):
            what = f"{area} {span.addresses} do not all exist in this image"
            yield error(row.path, what, f"its {area}: {show_ranges(ranges)}")
        if area in {Area.COILS, Area.DISCRETE} and any(value > 1 for value in row.values):
            yield error((*row.path, "values"), f"{area} can only be 0 or 1")


def _check_mirror(image: Image) -> Iterator[Problem]:
    for key in ("profile", "persist", "initial", *Area):
        if image.has(key):
            yield error((*image.path, key), "a mirror has what its device has", "take the key out, or of")
    for key in filter(image.has, ("map", "when_stale")):
        yield error((*image.path, key), "a mirror has no map", "take the key out, or of")
    if not image.read:
        remedy = 'write read = [{ holding = "0-1", every = "500 ms" }]'
        yield error(image.path, "is a mirror that polls nothing", remedy)
    for row in image.read:
        if sum(row.has(area) for area in Area) != 1:
            yield error(row.path, "must name one of holding, input, coils and discrete")
        for area in Area:
            if row.has(area) and not ranges_in(area, row):
                yield error((*row.path, area), "names no address", "write the first and the last one, such as 0-9")
        if row.every is not None and row.every >= image.stale:
            what = f"values become stale between two polls: stale is {show_duration(image.stale)}"
            yield warning((*row.path, "every"), what, "make stale two or three times as long as every")
    yield from _check_polled_once(image)


def _check_polled_once(image: Image) -> Iterator[Problem]:
    for area in Area:
        taken: list[Range] = []
        for row in image.read:
            for first, last in ranges_in(area, row):
                if any(first <= other_last and other_first <= last for other_first, other_last in taken):
                    yield error((*row.path, area), f"{area} {first}-{last} overlap with an earlier row")
                taken.append((first, last))


def _check_polled(image: Image, device: str, profile: ProfileTable) -> Iterator[Problem]:
    """Find polls of what the device does not have."""
    for row, area in ((row, area) for row in image.read for area in Area if row.has(area)):
        path, exist = (*row.path, area), getattr(profile, area)
        wide = profile.wide.get(area, ())
        if any(one[0] <= other[1] and other[0] <= one[1] for one in ranges_in(area, row) for other in wide):
            yield error(path, f"registers of {device} with four bytes cannot be mirrored", "leave them out")
        spans = [Span(area, first, last + 1 - first) for first, last in ranges_in(area, row)]
        found = (each for span in spans for each in cannot_be_polled(device, profile.functions, exist, span))
        for what, remedy in dict.fromkeys(found):
            yield error(path, what, remedy)


def check_intervals(config: Config, failed: frozenset[str]) -> Iterator[Problem]:
    """Find rows without `every`, rows that have it though others ask, and rows that would write there."""
    if failed & {"line", "upstream"}:  # what is a device of a monitor line is not known
        return
    heard = heard_on(config)
    for image in config.image:
        for row in image.read if image.of is not None else ():
            yield from _check(row.path, image.of, row.every, "500 ms", heard)
        for mapped in image.map:
            if mapped.device is None:
                continue
            yield from _check(mapped.path, mapped.device, mapped.every, "1 s", heard)
            if mapped.write and mapped.device in heard:
                what = f"nothing is ever sent on {heard[mapped.device]}: writes to this row are answered 0A"
                yield warning((*mapped.path, "write"), what, "take it out")


def _check(
    path: Path, device: str | None, every: float | None, usual: str, heard: Mapping[str, str]
) -> Iterator[Problem]:
    line = heard.get(device or "")
    if line is None:
        if every is None:
            yield error(path, "every is missing", f'say how often it is read, such as every = "{usual}"')
    elif every is not None:
        what = f"others ask {device}, and the gateway only listens on {line}: nothing is read there"
        yield error((*path, "every"), what, "take it out: values come when they are heard")
