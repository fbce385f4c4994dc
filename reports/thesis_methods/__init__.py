"""The thesis's own methods: its mapping, positioning, angle and force, and its circuit."""
