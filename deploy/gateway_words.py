"""The words of the gateway that pages translate: states, results, functions and others, read where they are defined.

`babel.toml` names this as an extractor: `pybabel extract` takes these words for texts of `gateway/web/text/words.py`.
"""

from collections.abc import Iterator
from typing import Any, Final, get_args, get_type_hints

import gateway.errors
from gateway.config.problem import Severity
from gateway.diagnosis.finding import Level
from gateway.modbus.codes import Area
from gateway.operator.operations.answers import status
from gateway.operator.operations.answers.known_values import ValueState
from gateway.operator.operations.answers.trouble import Trouble
from gateway.operator.operations.answers.values import CellState
from gateway.operator.operations.asked import LEVELS
from gateway.operator.status.unit_states import ShownState
from gateway.operator.values.complaint import WHYS, exception_name
from gateway.readconfig.page_users import ROLES
from gateway.registers.datatypes import SWAPS
from gateway.trace.pdus import EXCEPTIONS, FUNCTIONS
from gateway.trace.records import RESULTS
from gateway.web.text.words import ENGLISH

#: Those of the table of rights: `gateway/config/plan/rights_in_words.py`.
OF_RIGHTS: Final = (
    *("all", "all else", "nothing", "read, write", "read", "write", "read, write, broadcast", "high"),
    *("any listener", "anywhere", "this machine", "who may open it", "the line", "the broker"),
    *("operators", "other users of the page", "other sites", "units made in Python"),
)


def words() -> set[str]:
    """Collect the words, under the names that the gateway has for them."""
    told = (each for each in vars(status).values() if isinstance(each, type) and each is not status.StateFileStatus)
    states = [hints["state"] for hints in map(get_type_hints, told) if "state" in hints]
    results = {each.result for each in vars(gateway.errors).values() if hasattr(each, "result")}
    known = (
        *states,
        get_type_hints(ShownState)["word"],
        get_type_hints(Trouble)["kind"],
        CellState,
        ValueState,
        Level,
        Severity,
    )
    tables = (*FUNCTIONS.values(), *EXCEPTIONS.values(), *WHYS.values())
    lists = (*RESULTS, *ROLES, *LEVELS, *SWAPS, *map(str, Area), *OF_RIGHTS, *ENGLISH)
    exceptions = {exception_name(code) for code in range(256)}
    return {*results, *tables, *lists, *exceptions, *(word for each in known for word in get_args(each))} - {""}


def extract(*_of_babel: Any, **_options: Any) -> Iterator[tuple[int, str, str, list[str]]]:
    """Yield the words in English, for Babel."""
    for text in sorted({ENGLISH.get(word, word) for word in words()}):
        yield 0, "", text, []
