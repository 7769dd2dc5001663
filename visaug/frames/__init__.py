"""Measured frames: readers for what cameras and standards write, and the set they form."""

from visaug.frames.frameset import FrameSet
from visaug.frames.record import KINDS, FrameRecord, Group
from visaug.frames.table import read_table, write_table

__all__ = ["KINDS", "FrameRecord", "FrameSet", "Group", "read_table", "write_table"]
