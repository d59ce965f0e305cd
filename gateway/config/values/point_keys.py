"""The keys of a point: its name, its place, its labels, and whether it can be written."""

import re

from gateway.config.problem import NotText, WrongValue
from gateway.config.values.names import LONGEST_NAME
from gateway.config.values.ranges import parse_ranges
from gateway.modbus.codes import Area
from gateway.profiles.point import Writing
from gateway.profiles.profile import Range

_WHOLE_NUMBER = re.compile(r"-?[0-9]{1,20}")
#: With a star, which stands for a number.
_POINT_NAME = re.compile(r"[^\W\d_][\w.*-]*")


def parse_point_name(value: object) -> str:
    """Parse the name of a point, which is typed behind a command and becomes a part of topics.

    Raises:
        WrongValue: it is none, or the name of an area.
    """
    if not isinstance(value, str):
        raise NotText
    if not _POINT_NAME.fullmatch(value) or len(value) > LONGEST_NAME:
        what = f'"{value}" is no name of a point'
        raise WrongValue(what, f"letters, digits, - _ and . are allowed, a letter first, at most {LONGEST_NAME}")
    if value in set(Area):
        raise WrongValue(f'"{value}" is the name of an area', "choose another name")
    return value


def parse_point_addresses(value: object) -> Range:
    """Parse where a point is: an address, or first and last of several points.

    Raises:
        WrongValue: it is neither.
    """
    if isinstance(value, int) and not isinstance(value, bool):
        value = str(value)
    ranges = parse_ranges(value) if isinstance(value, str) else ()
    if len(ranges) != 1:
        raise WrongValue("is no address", 'write an address such as 16, or a range "1-99" for several points')
    return ranges[0]


def parse_labels(value: object) -> dict[int, str]:
    """Parse what numbers mean, as in `{ 0 = "off", 1 = "running" }`.

    Raises:
        WrongValue: a key is no whole number or is there twice, or a label is no text or is there twice.
    """
    if not isinstance(value, dict):
        raise WrongValue("must be a table", 'write it as { 0 = "off", 1 = "running" }')
    labels: dict[int, str] = {}
    for text, label in value.items():
        if not _WHOLE_NUMBER.fullmatch(text):
            raise WrongValue(f'"{text}" is no whole number', 'labels are for numbers: { 0 = "off", 1 = "running" }')
        if not isinstance(label, str) or not label.strip():
            raise WrongValue(f"the label of {text} must be text", f'write {text} = "running"')
        if int(text) in labels:
            raise WrongValue(f"{int(text)} is there twice")
        if label in labels.values():
            raise WrongValue(f'"{label}" is there twice')
        labels[int(text)] = label
    return labels


def parse_writing(value: object) -> Writing:
    """Parse whether a point can be written.

    Raises:
        WrongValue: it is none of those that are known.
    """
    if isinstance(value, bool):
        return "yes" if value else "no"
    if value == "only":
        return "only"
    remedy = "true and false have no quotes" if isinstance(value, str) else ""
    raise WrongValue('must be true, false or "only"', remedy)
