"""Learning: networks of our own, what they learn from, and the loop."""
