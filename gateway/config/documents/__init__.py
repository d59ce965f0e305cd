"""What is made of the schema, and of profiles.

- reference    docs/configuration.md
- json_schema    the schema for editors
- completion     the same for the page that completes keys
- points_csv     the points of a profile as CSV
- profile_pages    docs/profiles
- point_rows     points in words, for tables
"""
