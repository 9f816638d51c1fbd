"""Which jobs of a sweep are composed before it starts."""

from itertools import product

from bench.sweep import representatives


def test_each_choice_of_a_group_is_in_one_job_and_few_jobs_are_needed():
    groups = [[f"method={m}" for m in "abcdef"], [f"dataset={d}" for d in "uvwxyz"], ["seed=0", "seed=1"]]
    batch = [list(job) for job in product(*groups)]
    chosen = representatives(batch)
    assert {o for job in chosen for o in job} == {o for group in groups for o in group}
    assert len(chosen) <= sum(map(len, groups)) - 2


def test_a_parameter_is_tried_with_every_plugin_of_its_group():
    batch = [[f"method={m}", f"method.k={k}", f"seed={s}"] for m, k, s in product("ab", "12", "34")]
    chosen = {tuple(job[:2]) for job in representatives(batch)}
    assert chosen == {(f"method={m}", f"method.k={k}") for m, k in product("ab", "12")}


def test_one_job_stands_for_itself():
    assert representatives([[]]) == []
    assert representatives([["+method.typo=3"]]) == [["+method.typo=3"]]
