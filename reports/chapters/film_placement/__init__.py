"""The measured positions: what one shift and turn of the film, and gains, explain of them."""
