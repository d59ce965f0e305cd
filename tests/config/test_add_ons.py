"""The list of add-ons, and the sections that it means."""

from gateway.config.add_ons import ADD_ONS
from gateway.config.plan.settings import Plan
from gateway.config.schema.config import Config
from gateway.config.schema.table import row_model
from gateway.config.values.reserved_names import CONTROL, EMBEDDED, RESERVED


def test_an_add_on_is_a_section_that_a_file_may_leave_out():
    for add_on in ADD_ONS:
        field = Config.model_fields[add_on.key]
        assert field.default is None
        assert set(add_on.files) <= set(row_model(field.annotation).model_fields)


def test_an_add_on_adds_nothing_that_a_file_does_not_ask_for():
    for add_on in ADD_ONS:
        assert add_on.add(Plan(), Config()) == Plan()


def test_rows_of_access_may_name_every_add_on():
    assert [add_on.key for add_on in ADD_ONS if add_on.key not in RESERVED] == []
    assert {add_on.key for add_on in ADD_ONS} | {CONTROL, EMBEDDED} == set(RESERVED)
