"""``python -m torch_activegp``: the same as ``torch-activegp``."""

from torch_activegp.cli import main

if __name__ == "__main__":
    main()
