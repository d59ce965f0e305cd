"""Cross-checks: what no single key can tell. `config/check.py` calls them.

- listeners, own_listeners, access, tls    where clients connect, and their rights
- lines, retries, line_load    the keys of a line, repeats, and the time that polls need
- units, duplicates    one destination for each unit; names, ports and leases that are used once
- profiles, reference_numbers    kinds of devices; addresses that may be numbers of a manual
- points, point_places, point_values, point_writing    points: their names, places and values, and how they are written
- images, maps, map_rows    images, mirrors and virtual units; the maps of these, and single rows
- intervals    how often mirrors and virtual units read
- upstreams    other servers
- web, mqtt, fleet, lease    the add-ons
- embedding    what a program gives to a gateway that is a part of it
"""
