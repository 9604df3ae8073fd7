"""What is settled before names are tried: numerics, length of segments, and the noise that a fit leaves."""
