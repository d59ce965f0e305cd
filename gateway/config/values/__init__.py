"""The kinds of values that keys have: what a user writes becomes what parts are given.

- key_types, kind    the types of keys, and what the documents say of each
- address, port, networks, site, broker, fleet    where something is
- duration, size, character_format    amounts
- names, reserved_names, files    text
- unitset, ranges, point_keys, profile_keys    units, addresses, points, kinds of devices
"""
