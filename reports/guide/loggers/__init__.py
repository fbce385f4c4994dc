"""Scripts that track touches in the readings of common loggers; the guide shows them."""
