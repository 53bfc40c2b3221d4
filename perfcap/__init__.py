"""perfcap: human performance capture in PyTorch."""

__version__ = "0.1.0"
