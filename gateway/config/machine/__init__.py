"""What is seen of this machine.

- file_text    the text of a config file
- known_kinds    the kinds of devices that a scan can recognise
- unit_class   the class of a unit that is made in Python
- file_trouble, port_trouble, address_trouble    why the service cannot read the file, open a port, or listen
"""
