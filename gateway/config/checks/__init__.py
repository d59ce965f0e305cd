"""Cross-checks: what no single key can tell. `config/check.py` calls them.

- listeners, access, tls    where clients connect, and their rights
- lines, times    the keys of a line; repeats, leases, and the time that polls need
- units       one destination for each unit; names, ports and leases that are used once
- profiles, reference_numbers    kinds of devices; addresses that may be numbers of a manual
- points, point_values, point_writing    points: names and values, where they are, how they are read and written
- images, maps    images, mirrors and virtual units; the maps of these
- upstreams    other servers
- web, mqtt, fleet    the add-ons
- embedding    what a program gives to a gateway that is a part of it
"""
