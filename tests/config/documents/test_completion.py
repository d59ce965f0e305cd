"""What the page completes is what the schema has."""

import json
from pathlib import Path

from deploy.config_keys import completion
from gateway.config.documents.json_schema import json_schema

KEYS = Path("gateway/web/pages/static/config-keys.json")


def test_the_file_is_made_of_the_present_schema():
    assert json.loads(KEYS.read_text()) == completion(), "not current: uvx nox -s gen"


def test_each_key_of_each_table_is_there():
    schema = json_schema()
    found = completion()
    assert {name: set(keys) for name, keys in found.items() if name} == {
        name: set(table["properties"]) for name, table in schema["definitions"].items()
    }
    assert set(found[""]) == set(schema["properties"])


def test_values_tables_and_lists_are_told():
    found = completion()
    assert found["Line"]["mode"]["values"] == ["rtu", "ascii"]
    assert found["Line"]["echo"]["values"] == [True, False]
    assert (found["Line"]["devices"]["table"], found["Line"]["devices"]["list"]) == ("Device", True)
    assert found[""]["profile"] == {"table": "ProfileTable", "named": True}
    assert all(each["table"] in found for keys in found.values() for each in keys.values() if "table" in each)


def test_it_is_small():
    assert KEYS.stat().st_size < 32 * 1024
