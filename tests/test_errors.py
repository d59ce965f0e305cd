import re

import pytest

from gateway import errors

#: Name and exception code, as the table of answers in the documentation promises them to clients.
CODES = {
    "Refused": 0x04,
    "IllegalFunction": 0x01,
    "AccessDenied": 0x01,
    "IllegalAddress": 0x02,
    "IllegalValue": 0x03,
    "DeviceFailure": 0x04,
    "LineShared": 0x04,
    "Busy": 0x06,
    "QueueFull": 0x06,
    "WaitedTooLong": 0x06,
    "Unwanted": 0x06,
    "NoRoute": 0x0A,
    "OnlyHeard": 0x0A,
    "LineDown": 0x0A,
    "NoResponse": 0x0B,
    "ResponseTimeout": 0x0B,
    "BrokenResponse": 0x0B,
    "LineLost": 0x0B,
    "AnswerOverdue": 0x0B,
    "UnitResting": 0x0B,
    "EchoSuspected": 0x0B,
    "AmbiguousResponse": 0x0B,
    "StaleValue": 0x0B,
}


def subclasses(cls: type) -> list[type]:
    return [one for sub in cls.__subclasses__() if sub.__module__ == errors.__name__ for one in (sub, *subclasses(sub))]


def tree(cls: type, indent: int = 0) -> list[tuple[int, str]]:
    """Depth and name of `cls` and all below it, in the order of definition."""
    below = [sub for sub in cls.__subclasses__() if sub.__module__ == errors.__name__]
    return [(indent, cls.__name__), *(row for sub in below for row in tree(sub, indent + 1))]


def test_the_tree_in_the_docstring_is_the_tree():
    drawn = re.findall(r"^([│├└─ ]*)([A-Z][A-Za-z]+Error|[A-Z][A-Za-z]+)(?:  |$)", errors.__doc__, re.MULTILINE)
    assert [(len(branch) // 4, name) for branch, name in drawn] == tree(errors.GatewayError)


def test_the_codes_in_the_docstring_are_the_codes():
    drawn = re.findall(r"(\w+) +(0[0-9AB])  ", errors.__doc__)
    assert {name: int(code, 16) for name, code in drawn} == CODES


@pytest.mark.parametrize("error", subclasses(errors.RequestError), ids=lambda error: error.__name__)
def test_each_request_error_has_its_exception_code(error):
    assert error.code == CODES[error.__name__]


def test_a_connection_or_port_that_fails_is_no_answer_to_a_request():
    assert not issubclass(errors.NotModbus, errors.RequestError)
    assert not issubclass(errors.PortError, errors.RequestError)
