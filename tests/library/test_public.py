"""What is public stays: `public.txt` has each name and signature that a program may use."""

from difflib import ndiff
from pathlib import Path

import gateway
from gateway import events
from library.public_names import public_names

WRITTEN_DOWN = Path(__file__).with_name("public.txt")
WHAT_TO_DO = """What a program may use of the gateway has changed:

{changes}

- A line is gone, or changed so that a program which was right now fails: put it back; or, if that cannot be, the next
  version is a major one.
- A new line is a promise, kept until the next major version: is it one that a user has asked for?
- Either way, write a line into CHANGELOG.md, then
  PYTHONPATH=. .venv/bin/python tests/library/public_names.py > tests/library/public.txt
"""


def test_what_is_public_is_as_it_was_written_down():
    was = WRITTEN_DOWN.read_text(encoding="utf-8").splitlines()
    changes = [line for line in ndiff(was, [*public_names()]) if line[0] in "+-"]
    assert not changes, WHAT_TO_DO.format(changes="\n".join(changes))


def test_each_public_name_can_be_imported_and_nothing_else_is_listed():
    assert {name: hasattr(gateway, name) for name in gateway.__all__} == dict.fromkeys(gateway.__all__, True)
    assert sorted(dir(gateway)) == sorted(gateway.__all__)
    assert {name: hasattr(events, name) for name in events.__all__} == dict.fromkeys(events.__all__, True)


def test_each_public_class_says_what_it_is_for():
    classes = [value for name in gateway.__all__ if isinstance(value := getattr(gateway, name), type)]
    said = {each.__name__: bool(each.__doc__) for each in classes}
    assert said == dict.fromkeys(said, True)
