"""The report script on tracking streams with the faults of real hardware."""
