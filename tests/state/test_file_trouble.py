"""That a file is not written is told once, whatever keeps it from being written, and so is that it is again."""

from gateway.events import Event, StateKeptAgain, StateNotKept
from gateway.state.file_trouble import FileTrouble


def test_trouble_is_told_once_until_it_is_over():
    told: list[Event] = []
    trouble = FileTrouble("/state/file", told.append)
    for reason in ("", "full", "broken", "", ""):
        trouble.tell(reason)
    assert told == [StateNotKept("/state/file", "full"), StateKeptAgain("/state/file")]


def test_an_error_without_a_text_is_trouble_too():
    told: list[Event] = []
    trouble = FileTrouble("/state/file", told.append)
    for error in (OSError(28, "No space left on device"), MemoryError()):
        trouble.failed(error)
        assert trouble.reason
    assert told == [StateNotKept("/state/file", "No space left on device")]
    trouble.tell("")
    trouble.failed(MemoryError())
    assert told[-1] == StateNotKept("/state/file", "MemoryError")
