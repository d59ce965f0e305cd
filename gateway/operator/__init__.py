"""What an operator asks of a gateway at work, and its answers.

- operations   ALL that may be asked: name, parameters, result, right; the doors are made of this table
- operation    what a row is
- parameters, results    questions are read from JSON or text, and answers from JSON
- operator     what is asked: the gateway at work
- answers      the types of the answers
- status, running, units, forgetting    how the gateway is doing, its reload, its units
- requests, frames    a request to a unit, and the frames that it led to
- trace, stories, unit_names, capture, trace_reader, sampling    what has passed, and why requests failed
- answer_times, calibration, failures, kept, reached    what pages show of a unit and of an image
- history, uses    what lines and units did in the last days
- metrics, rights, config_view    counters, access rights, the config
"""
