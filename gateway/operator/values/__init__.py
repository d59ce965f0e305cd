"""Values of units: read, written, and known from what passes.

- steps        the requests that read and write values, for all doors and for the command line without a gateway
- complaint    an exception response in words
- requests, frames    a request to a unit through the gateway, and its frames on the line
- unit_values, last_values, reading_and_writing    values read and written through the gateway, as operations
- known_values, passed    the latest values of points, and of registers without one, out of what passes
- values_csv   the latest values as a file for spreadsheets
"""
