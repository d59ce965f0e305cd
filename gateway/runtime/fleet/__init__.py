"""`[fleet]`: other sites, as long as the config names NATS servers. What talks to them is in `gateway.fleet`.

- add_on       the connection: what asks other sites, and what they may ask here
- presence     what this site reports about itself
- known_sites  what all sites report, kept for a moment
- shared_line  a line with a lease, and what moves to its next holder
- metrics, findings    what is counted, and what `doctor` says
"""
