"""What commands print.

- status, status_tables, advice    `status`: tables, and the notes below them
- fleet, hub    `status --fleet`, and `fleet hub`
- check, quotes    `check`: all of it, and the lines that are wrong; the parts of a config are in the modules below
- listeners, rights, lines, line_load, servers, monitors, sites, images, guarded, published    parts of a config
- virtual, mapped    virtual units, and what stands at their addresses
- known_values    `values`
- map, register_map    `map`
- limits    time limits and longest waits, for `check` and `profile`
- trace_rows    `trace`
- bench    `bench`
- calibration, measured_profile    `calibrate`
- operations    `ask`
"""
