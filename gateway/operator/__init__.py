"""Operations: what can be asked of a running gateway, and the answers.

- operations   the table of all operations: name, parameters, result, right; every door is built from it
- operation    one row of that table
- parameters, results, json_text    read parameters from JSON or text, and results from JSON; write answers as JSON
- asked, answers    the types of parameters and of results
- operator     the running gateway, and what operations keep between requests
- status, running, lines, units, forgetting    the status, the reload, lines, units, `forget`
- inventory    what the gateway is and has
- sites, sites_csv    which sites of a fleet are not fine, what they have in common; as a file for spreadsheets
- troubles, unit_states    what is wrong now
- requests, frames, complaint    a request to a unit, its frames on the line, and an exception in words
- values       requests that read and write values, for all doors and for the command line without a gateway
- known_values, values_csv, passed    the latest values of points, and of registers without one, out of what passes
- unit_values, last_values, reading_and_writing    the same through the gateway, as operations
- images, grid, kept    values of images and mirrors
- trace, stories, unit_names, capture, trace_reader, sampling    recorded traffic, and why requests failed
- meanings     what a recorded transaction means, where it covers points
- answer_times, calibration, failures, reached    what pages show of a unit
- happened    the last events
- history, uses, past, minutes    what lines and units did in the last days
- trends       how values of points went
- metrics, rights    counters, access rights
- config_view, applied    the config, and those that were in use before
- config_check, config_commands    a text that might replace it, and the commands that do it
"""
