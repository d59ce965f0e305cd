"""The file of `fleet hub`, read and checked."""

from collections import Counter
from collections.abc import Iterator
from typing import Final, NamedTuple

from pydantic import ValidationError

from gateway.config.problem import Path, Problem, did_you_mean, error
from gateway.config.reading.syntax import read_document
from gateway.config.reading.wording import value_problems
from gateway.config.schema.hub import Hub

#: The name of the server and its JetStream: a leaf node, which has those of its site, cannot have the same.
DOMAIN: Final = "hub"
_NEEDS: Final = (("certificate", "key"), ("key", "certificate"), ("ca", "certificate"))


class HubFile(NamedTuple):
    """A file that was read: its sites if it has no problem, and its problems."""

    hub: Hub | None
    problems: tuple[Problem, ...]


def parse_hub_file(text: str, file: str) -> HubFile:
    """Parse `text`, the content of `file`."""
    read = read_document(text, file)
    if isinstance(read, Problem):
        return HubFile(None, (read,))
    document, positions = read
    try:
        hub = Hub.model_validate(document)
    except ValidationError as wrong:
        problems = [*value_problems(wrong, Hub, (), positions.written)]
        return HubFile(None, tuple(positions.locate(each, file) for each in problems))
    found = tuple(positions.locate(each, file) for each in _check(hub))
    return HubFile(None if found else hub, found)


def _check(hub: Hub) -> Iterator[Problem]:
    """Find what does not fit together."""
    yield from _check_names(hub)
    yield from _check_asks(hub)
    for index, lease in enumerate(hub.leases):
        yield from _check_known(hub, ("leases", index), lease.partition(".")[0])
        if lease in hub.leases[:index]:
            yield error(("leases", index), f"{lease} is there twice", "remove it here")
    for index, site in enumerate(hub.leaf_nodes):
        yield from _check_known(hub, ("leaf_nodes", index), site)
        if site in hub.control:
            what = f"{site} makes the buckets at the hub, so it cannot have a leaf node"
            yield error(("leaf_nodes", index), what, "let its gateways connect to the hub")
        if site == DOMAIN:
            yield error(
                ("leaf_nodes", index), f"{site} is the name of the server itself", "give this site another name"
            )
    if hub.leaf_nodes and hub.address is None:
        yield error(("leaf_nodes",), "leaf nodes need the address of the hub", 'add address = "hub.plant.example"')
    for one, other in _NEEDS:
        if hub.has(one) and not hub.has(other):
            yield error((one,), f"has no effect without {other}", f"add {other}")


def _check_names(hub: Hub) -> Iterator[Problem]:
    control = hub.control
    if not hub.sites and len(control) == 1:
        yield error(("sites",), "names no site", 'such as sites = ["plant-1", "plant-2"]')
    for name, count in Counter(control).items():
        if count > 1:
            yield error(("control",), f"{name} is there twice", "remove it once")
    for index, name in enumerate(hub.sites):
        path = ("sites", index)
        if name in control:
            yield error(path, f"{name} is control too, which may be asked like any site", "remove it here")
        elif name in hub.sites[:index]:
            yield error(path, f"{name} is there twice", "remove it here, or give this site another name")
        elif other := next((each for each in (*control, *hub.sites[:index]) if each.lower() == name.lower()), ""):
            what = f"{name} differs from {other} only in capitals, so their files can be the same"
            yield error(path, what, "give one of them another name")


def _check_asks(hub: Hub) -> Iterator[Problem]:
    for asker, asked in hub.asks.items():
        path: Path = ("asks", asker)
        if asker in hub.control:
            yield Problem("error", path, f"{asker} may ask all sites anyway", "remove it here", on_key=True)
        else:
            yield from _check_known(hub, path, asker, on_key=True)
        for index, site in enumerate(asked):
            yield from _check_known(hub, (*path, index), site)
            if site == asker:
                yield error((*path, index), f"{site} needs no right to its own units", "remove it here")
            elif site in asked[:index]:
                yield error((*path, index), f"{site} is there twice", "remove it here")


def _check_known(hub: Hub, path: Path, name: str, *, on_key: bool = False) -> Iterator[Problem]:
    sites = (*hub.control, *hub.sites)
    if name not in sites:
        yield Problem("error", path, f'there is no site "{name}"', _advise(name, sites), on_key=on_key)


def _advise(name: str, sites: tuple[str, ...]) -> str:
    meant = did_you_mean(name, sites)
    return meant if meant.startswith("did") else f'add it: sites = [..., "{name}"]'
