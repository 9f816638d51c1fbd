"""Calls timed by turns: what slows the machine for a while slows all of them."""

import statistics
import time


def medians_by_turns(calls, rounds):
    """The median seconds of each call, all of them once per round, after one round that does not count."""
    seconds = {name: [] for name in calls}
    for _ in range(rounds + 1):
        for name, call in calls.items():
            begin = time.perf_counter()
            call()
            seconds[name].append(time.perf_counter() - begin)
    return {name: statistics.median(times[1:]) for name, times in seconds.items()}
