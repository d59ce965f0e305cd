"""Draw what growth.py has measured: each row as a curve of its cost over its size.

    .venv/bin/python tests/bench/growth.py --json now.json && .venv/bin/python tests/bench/pictures.py now.json

It writes docs/pictures/growth.svg. A second file, `--before older.json`, is drawn in grey.
"""

import argparse
import json
from html import escape
from math import log
from pathlib import Path

PICTURE = Path(__file__).parents[2] / "docs/pictures/growth.svg"
COLOURS = ("#1f6f8b", "#5a9e6f", "#c98b2b", "#b5533c", "#6b5b95")
#: A panel, and the room around its axes, in pixels.
WIDTH, HEIGHT, LEFT, TOP, BOTTOM, RIGHT = 380, 190, 40, 56, 34, 40
#: So far apart numbers can be read, in pixels.
APART = 50

#: A row as growth.py writes it: `name`, `size` and `unit` in words, and `costs` at each size.
Row = dict


def picture(rows: list[Row], before: list[Row]) -> str:
    """The panels of all rows, two beside each other."""
    height = HEIGHT * ((len(rows) + 1) // 2)
    told = "; ".join(map(_told, rows))
    older = {_title(row): row for row in before}
    panels = [
        f'<g transform="translate({WIDTH * (number % 2)} {HEIGHT * (number // 2)})">'
        f"{panel(row, older.get(_title(row)), COLOURS[number % len(COLOURS)])}</g>"
        for number, row in enumerate(rows)
    ]
    size = f'viewBox="0 0 {2 * WIDTH} {height}" width="{2 * WIDTH}" height="{height}"'
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" {size} font-family="sans-serif" font-size="12" role="img" '
        f'aria-label="{escape(told)}">\n<rect width="{2 * WIDTH}" height="{height}" fill="#ffffff"/>\n'
        + "\n".join(panels)
        + "\n</svg>\n"
    )


def panel(row: Row, before: Row | None, colour: str) -> str:
    """One row: sizes along a logarithmic axis, costs from 0 on."""
    most = 1.15 * max([*_figures(row).values(), *(_figures(before).values() if before else ())])
    sizes = sorted(_figures(row))
    low = sizes[0] or sizes[1] / 2

    def across(size: float) -> float:
        return LEFT + (WIDTH - LEFT - RIGHT) * log(max(size, low) / low) / (log(sizes[-1] / low) or 1)

    def down(cost: float) -> float:
        return HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * cost / most

    def curve(figures: dict[float, float], ink: str) -> str:
        points = " ".join(f"{across(size):.0f},{down(cost):.0f}" for size, cost in figures.items())
        dots = "".join(
            f'<circle cx="{across(size):.0f}" cy="{down(cost):.0f}" r="3" fill="{ink}"/>'
            for size, cost in figures.items()
        )
        return f'<polyline points="{points}" fill="none" stroke="{ink}" stroke-width="2"/>{dots}'

    floor, left = HEIGHT - BOTTOM, LEFT / 2
    text = f'<text x="{left:.0f}" y="20" font-size="13" font-weight="bold">{escape(_plain(row["name"]))}</text>'
    text += f'<text x="{left:.0f}" y="38" fill="#555">{escape(row["unit"])}, by {escape(row["size"])}</text>'
    text += f'<path d="M{left:.0f} {floor}H{WIDTH - RIGHT / 2:.0f}" stroke="#888" stroke-width="2"/>'
    if before:
        text += curve(_figures(before), "#bbb")
    text += curve(_figures(row), colour)
    for size, cost in _figures(row).items():
        if size == sizes[-1] or across(size) < across(sizes[-1]) - APART:
            at = f'x="{across(size):.0f}" text-anchor="middle"'
            text += f'<text {at} y="{down(cost) - 8:.0f}">{_short(cost)}</text>'
            text += f'<text {at} y="{floor + 16}" fill="#555">{_short(size)}</text>'
    return text


def _title(row: Row) -> str:
    return f"{_plain(row['name'])}, by {row['size']}"


def _plain(text: str) -> str:
    return text.replace("`", "")


def _figures(row: Row) -> dict[float, float]:
    return {float(size): cost for size, cost in row["costs"].items()}


def _told(row: Row) -> str:
    figures = ", ".join(f"{_short(cost)} at {_short(size)}" for size, cost in _figures(row).items())
    return f"{_title(row)}: {figures} {row['unit']}"


def _short(number: float) -> str:
    return f"{number:,.0f}".replace(",", " ") if number >= 10 or number == int(number) else f"{number:.2g}"


def main() -> None:
    """Draw it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path, help="what growth.py has written")
    parser.add_argument("--before", type=Path, metavar="FILE", help="the same of an older gateway")
    args = parser.parse_args()
    before = json.loads(args.before.read_text()) if args.before else []
    PICTURE.write_text(picture(json.loads(args.file.read_text()), before))


if __name__ == "__main__":
    main()
