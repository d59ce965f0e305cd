"""A profile out of a table of registers: a sheet that somebody typed out of a manual, or one of `profile NAME --csv`.

- profile      the whole: a sheet in, a profile out
- sheet        bytes as rows of cells: the encoding, the delimiter, where the heading is
- headings     which column is which
- place        addresses and reference numbers
- words        what manuals call areas, types, word orders and access; numbers as spreadsheets have them
- row          a row as a point
"""
