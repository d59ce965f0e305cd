"""The kinds of devices that can be recognised: of a config, of own profiles, and those that are shipped.

Only what is needed for it is read of each file, which takes some milliseconds for each; a file with an error in that is
left out. `profile list` says what is wrong.
"""

import tomllib
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from gateway.config.machine.file_text import UnreadableFile, read_file_text
from gateway.config.machine.included import files_of
from gateway.config.machine.profile_folders import OWN_PROFILES, folders_of, names_in
from gateway.config.problem import WrongValue
from gateway.config.values.point_keys import parse_point_addresses
from gateway.config.values.profile_keys import parse_identity
from gateway.modbus.codes import Area
from gateway.profiles import shipped_names, shipped_text
from gateway.profiles.identity import Identity
from gateway.profiles.recognition import KnownKind
from gateway.profiles.sunspec import laid_out


def known_kinds(config: Path | None) -> list[KnownKind]:
    """Find all kinds for this config, or without one; of those with the same name the nearest."""
    found: dict[str, KnownKind | None] = {}
    for text in _texts(config):
        for name, kind in kinds_in(text):
            found.setdefault(name, kind)
    return [kind for kind in found.values() if kind is not None]


def kinds_in(text: str) -> Iterator[tuple[str, KnownKind | None]]:
    """Yield the profiles in a file, each with its kind, or None if it cannot be recognised."""
    try:
        profiles = tomllib.loads(text).get("profile", {})
    except (ValueError, RecursionError):
        return
    for name, table in profiles.items() if isinstance(profiles, dict) else ():
        try:
            yield name, _kind(name, table)
        except (WrongValue, LookupError, TypeError, AttributeError):
            yield name, None


def _kind(name: str, table: dict[str, Any]) -> KnownKind | None:
    if "identity" not in table:
        return None
    identity = parse_identity(table["identity"])
    return KnownKind(name, identity, table.get("mode"), laid_out(identity.sunspec, _holding(identity, table)))


def _holding(identity: Identity, table: dict[str, Any]) -> list[int]:
    """List the holding registers of the points, if it matters where they are."""
    points = table.get("points", ()) if identity.sunspec else ()
    ranges = [parse_point_addresses(point[Area.HOLDING]) for point in points if Area.HOLDING in point]
    return [address for first, last in ranges for address in range(first, last + 1)]


def _texts(config: Path | None) -> Iterator[str]:
    """Yield the texts of all files, the nearest first."""
    folders = (OWN_PROFILES,) if config is None else folders_of(config)
    own = [] if config is None else files_of(config)
    for file in own + [file for folder in folders for file in _files(folder)]:
        with suppress(UnreadableFile):
            yield read_file_text(file)
    for name in shipped_names():
        yield shipped_text(name) or ""


def _files(folder: Path) -> list[Path]:
    try:
        return [folder / f"{name}.toml" for name in names_in(folder)]
    except OSError:
        return []
