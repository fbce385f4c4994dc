"""Readings of instruments: tables and recordings, whatever program has written them."""
