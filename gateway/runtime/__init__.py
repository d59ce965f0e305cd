"""A running gateway: its parts, how they are built from a plan, and how a reload replaces them.

A reload, from top to bottom: `Reloader` reads the config, `Builder` builds a gateway from its plan, reusing the parts
that are the same as before, and `Running.switch` replaces the previous one with it.

- reload, outcome      reads the config again, compares it with the one in use, says what has changed
- running              what outlives a reload; start, switch to another gateway, drain
- listening, open_ports, draining    what switch, start and stop do with listeners, and with ports
- build, reach         a gateway from a plan; which units each client reaches there, and by which numbers
- polls, reads         the polls of a unit, for all that want its values; the last reads of devices, over a reload
- gateway              what is built: a plan, its parts, the routes between them
- gateway_line, gateway_upstream, gateway_server, gateway_monitor    one table of the config with all that it needs
- custom_images, custom_units    the units made in Python, and where their calls are carried out
- routers              the routers of requests that come by no listener: control socket, HTTP
- add_ons, add_on      parts with a section of their own, in one list: what each must do
- mqtt, fleet          a room for each of them
- kept_state, remembered, overdue    from earlier runs: moved devices, changed rates, late responses
- recent, tightness, self_state, summary, port_records    what is counted, noticed and shown while it runs
- garbage              keeps Python's collector short
"""
