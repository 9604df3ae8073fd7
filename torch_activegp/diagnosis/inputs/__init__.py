"""What a diagnosis starts from: the nominal model, and recordings laid over it, checked and cut into segments."""
