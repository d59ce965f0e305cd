"""The name of a class in Python, as a config has it."""

import pytest

from gateway.config.problem import WrongValue
from gateway.config.values.names import parse_python_class


@pytest.mark.parametrize("text", ["clock:Clock", "plant.units.clock:Clock", "uhr_2:Zähler"])
def test_a_module_and_its_class(text):
    assert parse_python_class(text) == text


@pytest.mark.parametrize(
    ("text", "what", "remedy"),
    [
        ("clock.py:Clock", '"clock.py:Clock" is not module:Name', 'did you mean "clock:Clock"?'),
        ("clock.Clock", '"clock.Clock" is not module:Name', 'did you mean "clock:Clock"?'),
        ("plant.clock.Clock", '"plant.clock.Clock" is not module:Name', 'did you mean "plant.clock:Clock"?'),
        ("clock", '"clock" is not module:Name', 'write the module and its class, such as "clock:Clock"'),
        ("clock.py", '"clock.py" is not module:Name', 'write the module and its class, such as "clock:Clock"'),
        ("", '"" is not module:Name', 'write the module and its class, such as "clock:Clock"'),
        ("clock:", '"clock:" is not module:Name', 'write the module and its class, such as "clock:Clock"'),
        ("clock: Clock", '"clock: Clock" is not module:Name', 'write the module and its class, such as "clock:Clock"'),
        (
            "/etc/clock.py:Clock",
            "names a module, not a file",
            'write the module and its class, such as "clock:Clock"',
        ),
        (60, "must be text", ""),
    ],
)
def test_anything_else_is_refused_with_what_may_be_meant(text, what, remedy):
    with pytest.raises(WrongValue) as wrong:
        parse_python_class(text)
    assert (str(wrong.value), wrong.value.remedy) == (what, remedy)
