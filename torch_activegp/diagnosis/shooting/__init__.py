"""The multiple shooting likelihood and its fits: every segment has a free initial state."""
