"""What an agency files and a pilot takes along: one folder with a page, plans, defects and condition of a mission."""

from pavetwin.handover.contents import Handover, handover_of
from pavetwin.handover.files import HANDOVER_FILES, check_target, write_handover

__all__ = ["HANDOVER_FILES", "Handover", "check_target", "handover_of", "write_handover"]
