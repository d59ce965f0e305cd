"""Every key of the config file, its kind and its default: a module for each section.

- config       all sections, and `[self]`, `[control]`, `[trace]` and `[log]`
- listen, line, image, upstream, profile, access    what there may be several of
- add_ons      `[web]`, `[mqtt]` and `[fleet]`
- hub          the file of `fleet hub`
- table        what each table knows of itself
"""
