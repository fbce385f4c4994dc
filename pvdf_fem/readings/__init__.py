"""Readings of instruments: tables and recordings written by any program."""
