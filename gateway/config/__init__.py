"""The config file: its keys (schema), its reading (load), its cross-checks (check), and the parts' settings (plan)."""
