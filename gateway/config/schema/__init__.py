"""Every key of the config file, its kind and its default: a module for each section.

- config       all sections
- listen, line, image, upstream, profile, access    what there may be several of
- gateway      `[self]`, `[control]`, `[trace]` and `[log]`
- web, mqtt, fleet    the add-ons
- hub          the file of `fleet hub`
- table        what each table knows of itself
"""
