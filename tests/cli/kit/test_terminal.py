"""What commands print, and what a terminal gets of it."""

import io
import sys

import pytest

from gateway.cli.kit.terminal import no_control_characters


@pytest.mark.parametrize(
    ("encoding", "shown"),
    [("ascii", rb"caf\xe9 \u5de5"), ("cp1252", b"caf\xe9 \\u5de5"), ("utf-8", "café 工".encode())],
)
def test_what_the_encoding_lacks_is_escaped(monkeypatch: pytest.MonkeyPatch, encoding: str, shown: bytes) -> None:
    """A name may be in any script: no error, and least of all one that says that the gateway is of another version."""
    printed = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(printed, encoding))
    with no_control_characters():
        sys.stdout.write("café 工")
        sys.stdout.flush()
    assert printed.getvalue() == shown
