"""Targets: what runs the chunks of an ensemble. A scheme's formula is recorded once;
a target prints and runs it.

A target is a `Target` (`_target`) in the list of `registry`, and modules of its own: nothing
outside asks which target it has. `_numpy` needs no compiler, `_numba` is the compiled engine (extra
`fast`), and `cuda` runs on a card (extra `cuda`). `cuda-on-host` is the text of `cuda`, compiled by
the machine's C compiler for tests where there is no card.
"""
