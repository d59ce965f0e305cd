"""What is made of the schema.

- reference    docs/configuration.md
- json_schema    the schema for editors
"""
