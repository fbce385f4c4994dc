"""The report script on how well touches are found, with its kinds and tasks."""
