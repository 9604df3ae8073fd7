"""Simulates candidates, the nominal model with effects in it, over many segments side by side."""
