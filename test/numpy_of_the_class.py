"""Holds numpy of the tests, and of the processes that they start, to the class of this CPU; imported before numpy.

Commands do so by themselves; what a test calculates, or a forked command, is then the same to the last bit.
"""

from cable_twin.basics.cpu import hold_numpy_to_the_class

hold_numpy_to_the_class()
