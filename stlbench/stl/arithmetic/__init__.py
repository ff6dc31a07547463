"""Functions of numbers, of intervals, and of many values: what formulas are computed with. It knows no formula."""

import sys

#: the smallest normal float; training switches smaller ones off
SMALLEST = sys.float_info.min
