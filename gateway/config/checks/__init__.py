"""Cross-checks: what no single key can tell. `config/check.py` calls all of them, and says in which order."""
