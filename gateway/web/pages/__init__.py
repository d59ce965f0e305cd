"""The pages. They are made on the server, so that they appear at once and work without JavaScript.

- overview, values, line, unit, image, events, traffic, health, clients, sites, config, login    a page each
- config_change    a text that might become the config
- add_line, new_line    a line that is searched for units and written as text for the config
- points       the points of a unit, on its page and on that of an image
- writing, write_rights, questions, fields    forms, and writes that wait to be confirmed
- problem      errors as pages
- page, renderer, addresses, assets    what pages have in common, templates, paths of pages, and static files
- head, situation, tiles    how the gateway is doing: above every page, and on the first one
- heat_map, busy, histogram, line_past, trend, sparkline    pictures
- shown_lines, transactions, times, function_names    lines, units, records, times and names as shown
"""
