"""Calls to be measured in a process of their own; they import little, which that process has to wait for."""

import os
import signal
import time

import numpy as np


def hold(megabytes, seconds):
    block = np.ones(megabytes * 131072)  # 8 bytes each
    time.sleep(seconds)
    del block


def speak():
    return 12.5, 7.0


def refuse():
    raise ValueError("not this one\nnor the details")


def die():
    os.kill(os.getpid(), signal.SIGKILL)
