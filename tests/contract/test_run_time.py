"""How much time a method has left."""

from __future__ import annotations

import time

from bench import Run


def test_a_loop_that_asks_for_more_time_ends_before_the_limit():
    run, steps = Run(seconds=1.0), 0
    while run.time_for_more():
        time.sleep(0.1)
        steps += 1
    assert 0.3 < run.elapsed() < 1.0 and steps >= 2


def test_without_a_limit_there_is_always_time_and_with_none_left_there_is_not():
    assert Run().time_for_more() and not Run(seconds=0.0).time_for_more()
