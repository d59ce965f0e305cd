"""What commands print.

- status, status_tables, advice    `status`: tables, and the notes below them
- fleet    `status --fleet`
- check, quotes    `check`: all of it, and the lines that are wrong; the parts of a config are in the modules below
- listeners, lines, line_load, servers, images, published    parts of a config
- virtual    virtual units, and what stands at their addresses
- map, register_map    `map`
- devices    time limits and longest waits, for `check` and `profile`
- trace_rows    `trace`
- calibration    `calibrate`
"""
