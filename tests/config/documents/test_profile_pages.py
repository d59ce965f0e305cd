import pytest

from deploy.profile_pages import FOLDER, page, pages, write_pages
from gateway.config.documents.points import identity_text, number_text
from gateway.config.schema.profile import ProfileTable
from gateway.profiles import shipped_names

PAGES = pages()


def test_there_is_a_page_for_each_shipped_profile_and_no_other():
    wanted = {"index.md", *(f"{name}.md" for name in shipped_names())}
    assert {file.name for file in FOLDER.glob("*.md")} == wanted, "not current: uvx nox -s gen"


@pytest.mark.parametrize("name", PAGES)
def test_a_page_is_current(name):
    assert (FOLDER / name).read_text(encoding="utf-8") == PAGES[name], "not current: uvx nox -s gen"


def test_the_list_leads_to_each_page():
    assert "| [`mint`](mint.md) | Mint motion controller |  | printed frames |" in PAGES["index.md"]
    assert all(f"\n{name}\n" in PAGES["index.md"].partition("{toctree}")[2] for name in shipped_names())


def test_a_page_says_what_the_profile_says():
    page = PAGES["mint.md"]
    assert "| functions | 1, 2, 3, 5, 16, 23 |\n| most items | 99 of function 3 |\n| addresses | holding 1-99 |" in page
    assert "| 3 | 99 | 420 ms |" in page
    assert "| `comms-1` to `comms-99` | holding | 1-99 | 40002-40100 | int16 | yes |" in page
    assert "| `weight` | holding | 0 | 40001 | float32 | no |  |" in PAGES["weigher.md"]


def test_all_that_a_profile_may_say():
    table = ProfileTable.model_validate(
        {
            "title": "Meter.",
            "maker": "A | B",
            "source": "Protocol,\nedition 2",
            "seen": "simulated",
            "identity": {"sunspec": [1, 103]},
            "wide": {"holding": "5000-5999"},
            "max_gap": 8,
            "points": [
                {"name": "flow", "input": 12, "type": "int16", "scale": 0.1, "offset": 5, "unit": "m³/h", "max": 9},
                {"name": "mode", "holding": 3, "bits": "4-6", "labels": {"0": "a|b", "1": "*"}, "write": True},
            ],
        }
    )
    text = "# Wants a pause: `gap`.\n# Always.\n\n[profile.meter]  # not this\n# nor this"
    assert page("meter", table, text).partition("\n\nMeter.\n\n")[2] == (
        "Wants a pause: `gap`.\nAlways.\n\n"
        '```toml\ndevices = [{ unit = 1, name = "my-device", profile = "meter" }]\n```\n\n'
        "| | |\n|---|---|\n"
        "| maker | A \\| B |\n"
        "| source | Protocol, edition 2 |\n"
        "| seen | simulated |\n"
        "| recognised by | SunSpec models 1, 103 |\n"
        "| functions | all |\n"
        "| registers of four bytes | holding 5000-5999 |\n"
        "| read together | over gaps of up to 8 addresses |\n"
        "| time-out | 1 s for functions without an answer time |\n"
        "\n## Points\n\n"
        "| name | area | address | reference | type | scale | unit | write | limits | labels |\n"
        "|---|---|---|---|---|---|---|---|---|---|\n"
        "| `flow` | input | 12 | 30013 | int16 | x 0.1 + 5 | m³/h | no | up to 9 |  |\n"
        "| `mode` | holding | 3 | 40004 | uint16, bits 4-6 |  |  | yes |  | 0 a\\|b, 1 \\* |\n"
    )


@pytest.mark.parametrize(
    ("identity", "text"),
    [
        ({"fc43": "EM340"}, 'function 43/14 tells "EM340"'),
        ({"input": 11, "equals": 340}, "input 11 is 340"),
        ({"sunspec": [103]}, "SunSpec models 103"),
    ],
)
def test_how_a_kind_is_recognised(identity, text):
    table = ProfileTable.model_validate({"identity": identity})
    assert identity_text(table.identity) == text


def test_pages_of_profiles_that_are_gone_are_removed(tmp_path):
    (tmp_path / "old.md").touch()
    write_pages(tmp_path)
    assert {file.name: file.read_text() for file in tmp_path.iterdir()} == PAGES


@pytest.mark.parametrize(("number", "text"), [(None, ""), (1.0, "1"), (0.1, "0.1"), (-40, "-40"), (1e-7, "1e-07")])
def test_numbers_are_written_as_short_as_they_are_read_again(number, text):
    assert number_text(number) == text
