"""Processes that work for one that started them."""

import multiprocessing
import os
import signal
import threading


def serve_parent() -> None:
    """Make this process one that leaves Ctrl-C to its parent and ends with it.

    A killed parent can not stop its children: they look for themselves.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the one who started us says when to stop
    threading.Thread(target=_die_with_parent, daemon=True).start()


def _die_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
