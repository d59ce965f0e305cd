"""The settings of every part of a gateway, and what follows from them.

- settings     the settings of all parts: what is in memory once the config is read
- lines, images, profiles, access    these settings, made of the tables of the config
- points, unit_points    points of a table, and of each unit
- virtual, virtual_points    virtual units, and the points that follow from their rows
- map_rows, map_place, map_conversion    a row of them: where it stands, what it reads, how it is written
- add_ons      the settings of `[web]`, `[mqtt]` and `[fleet]`, made of their tables
- names, reach    names of devices, and which listener leads where: for the checks, too
- forecast, line_load    the time limits that follow; who wants what to be polled, and what that takes of a line
- rights_in_words    access rights for people
- differences    how two plans differ: what a reload changes
"""
