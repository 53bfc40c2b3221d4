"""``python -m perfcap``."""

from perfcap.cli import main

if __name__ == "__main__":
    main()
