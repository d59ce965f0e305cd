"""The sites of a fleet.

- inventory    what this gateway is and has, and what the other sites report
- sites, sites_csv    which sites are not fine, what they have in common; as a file for spreadsheets
"""
