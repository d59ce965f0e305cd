"""What an operator asks of a gateway at work, and its answers.

- operations   ALL that may be asked: name, parameters, result, right; the doors are made of this table
- operation    what a row is
- parameters, results    questions are read from JSON or text, and answers from JSON
- asked, answers    the types of the parameters and of the answers
- operator     what is asked: the gateway at work, and what is kept for those who ask
- status, running, lines, units, forgetting    how the gateway is doing, its reload, its lines and units
- requests, frames, complaint    a request to a unit, the frames that it led to, and an exception in words
- values       the requests that read and write values, for all doors and for the command line without a gateway
- unit_values, last_values, reading_and_writing    the same through the gateway, for many at a time, as operations
- images, grid, kept    what images and mirrors have
- trace, stories, unit_names, capture, trace_reader, sampling    what has passed, and why requests failed
- answer_times, calibration, failures, reached    what pages show of a unit
- history, uses, past    what lines and units did in the last days
- metrics, rights, config_view    counters, access rights, the config
"""
