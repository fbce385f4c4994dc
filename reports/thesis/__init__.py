"""The report script on the thesis, with its data and what is special to it."""
