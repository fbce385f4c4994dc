"""The guide: pages of text and cells, built by Sphinx."""
