"""The noise of recorded positions from the recordings alone."""
