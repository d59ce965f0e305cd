"""The languages and themes of the pages."""
