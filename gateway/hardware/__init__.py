"""Serial adapters: which there are, who uses them, and what their drivers are asked. Pseudo-terminals.

- listing      the ports of this machine, and links to them that survive a replug
- holders, device_files    who has a port open, and who may use it
- pseudo_terminals, closings    makes them; whether somebody has closed one
- ioctls       what is asked of a driver
"""
