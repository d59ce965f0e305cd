"""What is made of the schema: the reference of the config, and a JSON schema."""
