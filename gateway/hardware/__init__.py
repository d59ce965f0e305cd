"""Serial adapters: which there are, who uses them, and what their drivers are asked.

- listing      the ports of this machine, and links to them that survive a replug
- holders, device_files    who has a port open, and who may use it
- ioctls       what is asked of a driver
"""
