"""What is seen of this machine.

- file_text    the text of a config file, and why the service cannot read it
- included     the files that a config includes
- known_kinds    the kinds of devices that a scan can recognise
- unit_class   the class of a unit that is made in Python
- troubles     why the service cannot open a port, or listen
"""
