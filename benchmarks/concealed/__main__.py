"""``python -m benchmarks.concealed make|run|score|all``."""

from benchmarks.concealed.command import main

if __name__ == "__main__":
    main()
