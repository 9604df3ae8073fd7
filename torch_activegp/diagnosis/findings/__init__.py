"""What is said of a set of effects: where, how sure, how well it forecasts, what is left, what to record next."""
