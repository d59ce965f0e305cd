"""How Sphinx makes a site of these pages: `./deploy/go docs`."""

import re
import sys
import tomllib
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.transforms import SphinxTransform

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "docs")]  # the gateway of this checkout, and what is beside this file
SOURCE = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["urls"]["Source"]

project = "modbus-gateway"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx_copybutton", "from_docstrings"]
nitpicky = True
autodoc_default_options = {"member-order": "bysource"}
python_maximum_signature_line_length = 100
exclude_patterns = ["pictures"]
html_theme = "furo"
html_title = "modbus-gateway"
html_copy_source = False
html_search_scorer = str(ROOT / "docs" / "scorer.js")
html_show_sphinx = False
html_theme_options = {"source_edit_link": f"{SOURCE}/blob/main/docs/{{filename}}"}
myst_heading_anchors = 4
copybutton_prompt_text = "$ "
# The machine of the reader; the placeholder for the repository
linkcheck_ignore = [r"http://127\.0\.0\.1", re.escape(SOURCE)]

#: Words that users search for, by "page#section" or "page".
_SOUGHT_FILE = ROOT / "docs" / "search.toml"
_SOUGHT = tomllib.loads(_SOUGHT_FILE.read_text(encoding="utf-8"))

#: A link out of this folder, from a page in it: `](../deploy/gateway.toml)`.
_LEADS_OUT = re.compile(r"\]\(((?:\.\./)+)([^)#\s]+)")


def lead_to_the_source(app: Sphinx, page: str, text: list[str]) -> None:  # noqa: ARG001 - Sphinx passes it
    """Turn links to files that are not on the site into links to the repository."""
    depth = page.count("/") + 1

    def address(link: re.Match[str]) -> str:
        is_outside = link[1].count("../") >= depth
        if is_outside and not (ROOT / link[2]).exists():
            raise FileNotFoundError(f"{page}: there is no {link[2]}")
        return f"]({SOURCE}/blob/main/{link[2]}" if is_outside else link[0]

    text[0] = _LEADS_OUT.sub(address, text[0])


class EntersSoughtWords(SphinxTransform):
    """Makes an entry of the index, which the search looks at first, of each word of search.toml."""

    default_priority = 800  # before the index is read

    def apply(self, **kwargs: Any) -> None:  # noqa: ARG002 - Sphinx passes them
        """Enter the words of this page and of its sections."""
        page = self.env.current_document.docname
        sections = list(self.document.findall(nodes.section))
        by_place = {page: sections[0]} | {f"{page}#{each['slug']}": each for each in sections if "slug" in each}
        self.env.note_dependency(_SOUGHT_FILE)
        for place, words in _SOUGHT.items():
            if place.partition("#")[0] == page:
                section = by_place[place]  # a KeyError names what search.toml has and the page has no more
                entries = [("single", word, section["ids"][0], "main", None) for word in words]
                section.insert(1, addnodes.index(entries=entries))


def write_pages_with_entries(app: Sphinx, env: BuildEnvironment) -> list[str]:  # noqa: ARG001 - Sphinx passes it
    """Have these pages written each time: Sphinx forgets the entries of pages that have not changed."""
    return [page for page, entries in env.domains.index_domain.entries.items() if entries]


def setup(app: Sphinx) -> None:
    """Called by Sphinx."""
    if gone := [place for place in _SOUGHT if not (ROOT / "docs" / f"{place.partition('#')[0]}.md").exists()]:
        raise LookupError(f"search.toml: there is no {', '.join(gone)}")
    app.connect("source-read", lead_to_the_source)
    app.add_transform(EntersSoughtWords)
    app.connect("env-updated", write_pages_with_entries)
