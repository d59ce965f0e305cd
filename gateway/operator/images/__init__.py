"""Values that the gateway holds itself.

- cells        the operation `image`
- grid, kept   the values of images, mirrors and virtual units, with ages and writers
- map_lines    the rows of a virtual unit
"""
