"""Which set of effects explains the mismatch: screening, search, rivals, and the judgement of what was found."""
