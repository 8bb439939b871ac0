"""Holds numpy of the tests, and of the processes that they start, to the class of this CPU; imported before numpy.

Commands do so by themselves; what a test calculates, or a forked command, is then the same to the last bit. Neither has
more than one thread for linear algebra: others wait for work at full speed, on a core that another test has use for.
"""

import os

from cable_twin.basics.cpu import hold_numpy_to_the_class

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
hold_numpy_to_the_class()
