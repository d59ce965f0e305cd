"""The config of nats-server for a fleet, and the logins of its sites, out of a list of sites (ADR 48).

- config       the server of all sites: an account for each, and what passes between accounts
- leaf         the server of a site with a leaf node
- rights       what the gateway of a site may publish and hear
- known        the keys of sites, read back from an earlier config
- folder       makes, keeps and names the files
"""
