"""A page of HTML as tests look at it: its tags, its texts, and the rows of its tables."""

from html.parser import HTMLParser


class Markup(HTMLParser):
    """What a page is made of."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict]] = []
        self.texts: list[str] = []
        self._rows: list[list[str]] = []
        self._is_in_cell = False
        self.feed(text)

    def rows(self) -> list[list[str]]:
        """The rows of all tables but for their heads, each as the texts of its cells."""
        return [[" ".join(cell.split()) for cell in row] for row in self._rows if row]

    def handle_starttag(self, tag, attrs):
        attributes = dict(attrs)
        self.tags.append((tag, attributes))
        if tag == "tr":
            self._rows.append([])
        if tag == "td" or (tag == "th" and attributes.get("scope") == "row"):
            self._rows[-1].append("")
            self._is_in_cell = True

    def handle_endtag(self, tag):
        if tag in ("td", "th"):
            self._is_in_cell = False

    def handle_data(self, data):
        self.texts.append(data.strip())
        if self._is_in_cell:
            self._rows[-1][-1] += data + " "
