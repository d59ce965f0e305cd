"""The kinds of values that keys have: what a user writes becomes what parts are given.

Functions that parse or check a value raise WrongValue: what is wrong with it, and what to write instead.

- key_types, kind    the types of keys, and what the documents say of each
- address, port, site, broker, fleet    where something is
- duration    amounts
- names, reserved_names, files    text
- unitset, ranges, point_keys, profile_keys    units, addresses, points, kinds of devices
"""
