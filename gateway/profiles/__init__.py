"""What a kind of device accepts and how fast it answers. The built-in ones are the TOML files in this folder."""
