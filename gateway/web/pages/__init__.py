"""The pages: made on the server, so that they are there at once and without JavaScript too.

- overview, line, unit, image, traffic, health, clients, config, login    a page each
- writing, questions, fields    forms, and writes that wait to be confirmed
- problem      errors as pages
- renderer, addresses, assets    templates, where pages are, and their files
- heat_map, busy, histogram    pictures
- shown_lines, unit_states, transactions, times, function_names    lines, units, the trace, and words for what they have
"""
