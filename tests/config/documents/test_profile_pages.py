import pytest

from gateway.config.documents.points_csv import number_text
from gateway.config.documents.profile_pages import FOLDER, pages
from gateway.profiles import shipped_names

PAGES = pages()


def test_there_is_a_page_for_each_shipped_profile_and_no_other():
    command = "run: python -m gateway.config.documents.profile_pages"
    assert {file.name for file in FOLDER.glob("*.md")} == {"index.md", *(f"{name}.md" for name in shipped_names())}, (
        command
    )


@pytest.mark.parametrize("name", PAGES)
def test_a_page_is_current(name):
    command = "run: python -m gateway.config.documents.profile_pages"
    assert (FOLDER / name).read_text(encoding="utf-8") == PAGES[name], command


def test_the_list_leads_to_each_page():
    assert "| [`mint`](mint.md) | Mint motion controller |  | printed frames |" in PAGES["index.md"]
    assert all(f"\n{name}\n" in PAGES["index.md"].partition("{toctree}")[2] for name in shipped_names())


def test_a_page_says_what_the_profile_says():
    page = PAGES["mint.md"]
    assert "| functions | 1, 2, 3, 5, 16, 23 |\n| most items | 99 of function 3 |\n| addresses | holding 1-99 |" in page
    assert "| 3 | 99 | 420 ms |" in page
    assert "| `comms-*` | holding | 1-99 | 40002-40100 | int16 | yes |" in page
    assert "| `weight` | holding | 0 | 40001 | float32 | no |  |" in PAGES["weigher.md"]


@pytest.mark.parametrize(("number", "text"), [(None, ""), (1.0, "1"), (0.1, "0.1"), (-40, "-40"), (1e-7, "1e-07")])
def test_numbers_are_written_as_short_as_they_are_read_again(number, text):
    assert number_text(number) == text
