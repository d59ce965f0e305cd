"""Upstream: where clients connect, and their sessions."""
