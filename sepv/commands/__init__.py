"""The commands of ``sepv``, one a file; `sepv.cli` loads the one that is asked for."""
