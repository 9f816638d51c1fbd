"""What tables call a method: its preset, and what differs from it."""

import pytest
from boards import row, rows

from bench.errors import UsageError
from bench.plugins import presets as preset_files
from bench.plugins.registry import registry
from bench.plugins.schema import build, parameters, variant
from bench.ranking.leaderboard import leaderboard
from bench.ranking.naming import LONGEST, check_names, is_called, naming, parts_of, preset_of
from bench.ranking.report import render
from bench.ranking.report.look import Look
from bench.ranking.report.tables import tables
from bench.ranking.selection import select


def labels(*methods, **names):
    return list(naming(methods, names).labels.values())


@pytest.mark.parametrize("name", ["idf_30", "idf_bare", "idf_unguided"])
def test_a_preset_keeps_its_name(name):
    preset = preset_files.presets("method")[name]
    plugin = registry().find("method", preset.plugin)
    stored = variant(plugin, parameters(plugin, build(plugin, preset.values)))  # as rows have it
    assert labels((preset.plugin, stored)) == [name]
    assert preset_of(preset.plugin, f"{stored},seconds=5") == (name, ("seconds=5",))


def test_the_preset_with_most_parameters_is_used():
    bare = preset_files.variants("method", "idf")["idf_bare"]
    assert set(parts_of(preset_files.variants("method", "idf")["idf_unguided"])) < set(parts_of(bare))
    assert preset_of("idf", bare)[0] == "idf_bare"


def test_what_differs_stands_behind_it_and_what_all_share_below():
    found = naming([("idf", "omega=30,seconds=45"), ("siren", "seconds=45"), ("idf", "seconds=45")])
    assert list(found.labels.values()) == ["idf_30", "siren", "idf"]
    assert found.notes == ("All methods: seconds=45.",)
    assert labels(("idf", "omega=30,seconds=45"), ("siren", "")) == ["idf_30 (seconds=45)", "siren"]
    assert labels(("mine", "k=3")) == ["mine (k=3)"]  # alone it shares nothing
    both = naming([("mine", "k=3"), ("yours", "k=3")])
    assert list(both.labels.values()) == ["mine", "yours"] and both.notes == ("All methods: k=3.",)


def test_a_sweep_has_parameters_and_not_the_name_of_one_of_its_values():
    assert labels(("poisson", "depth=9"), ("poisson", "")) == ["poisson_9", "poisson"]
    assert labels(("poisson", "depth=9"), ("poisson", "depth=7")) == ["poisson (depth=9)", "poisson (depth=7)"]
    other = preset_files.variants("method", "idf")["idf_attenuated"]  # of another preset it is no sweep
    assert labels(("idf", "omega=30"), ("idf", f"{other},omega=20")) == ["idf_30", "idf_attenuated (omega=20)"]


def test_two_methods_of_one_name_are_distinguished():
    assert labels(("idf", "omega=30"), ("idf_30", "")) == ["idf (omega=30)", "idf_30"]
    assert labels(("a", ""), ("b", ""), a="Ours", b="Ours") == ["a", "b"]


def test_commas_within_values():
    assert parts_of("radii=[1, 2],steps=a(x=1,y=2)+b,name=c,d") == ("radii=[1, 2]", "steps=a(x=1,y=2)+b", "name=c,d")


def test_long_labels_are_shortened_and_their_parameters_noted():
    long = ",".join(f"parameter_{i}={i}" for i in range(9))
    found = naming([("m", long), ("n", "")])
    short = found.labels["m", long]
    assert len(short) <= LONGEST and short.endswith("…)") and "parameter_8=8" in found.notes[0]
    both = labels(("m", long), ("m", f"{long},parameter_9=9"))
    assert len(set(both)) == 2


@pytest.mark.parametrize(
    ("parts", "short"),
    [
        (("a=1", "b=" + "x" * 49), f"m (a=1, b={'x' * 49})"),  # 60 characters
        (("a=1", "b=" + "x" * 50), "m (a=1, …)"),
        (("a=1", "b=" + "x" * 46, "c=1"), f"m (a=1, b={'x' * 46}, …)"),  # 60 characters
        (("a=1", "b=" + "x" * 47, "c=1"), "m (a=1, …)"),  # the first ones: c=1 would say less
    ],
)
def test_a_short_label_has_as_many_parameters_as_fit(parts, short):
    found = naming([("m", ",".join(parts))])
    assert list(found.labels.values()) == [short]
    whole = f"m ({', '.join(parts)})"
    assert found.notes == (() if short == whole else (f"{short}: {whole}.",))


def test_new_names_are_for_plugins_presets_and_variants():
    two = [("idf", "omega=30"), ("idf", "")]
    assert list(naming(two, {"idf_30": "Ours"}).labels.values()) == ["Ours", "idf"]
    assert list(naming(two, {"idf[omega=30]": "Ours"}).labels.values()) == ["Ours", "idf"]
    assert list(naming(two, {"idf (omega=30)": "Ours"}).labels.values()) == ["Ours", "idf"]
    assert list(naming(two, {"idf": "IDF"}).labels.values()) == ["IDF (omega=30)", "IDF"]
    assert labels(("a", "k=3"), ("a", "k=4"), a="A") == ["A (k=3)", "A (k=4)"]
    assert labels(two[0], idf="IDF") == ["IDF"]
    assert labels(("mine", "k=3"), mine="Ours") == ["Ours"]
    with pytest.raises(UsageError, match="no table has 'idff'.*Did you mean 'idf'"):
        check_names({"idff": "x"}, [two], ["d"])
    with pytest.raises(UsageError, match="Did you mean 'idf'"):
        check_names({"idff": "x"}, [two[:1]], ["d"])
    check_names({"idf_30": "x", "d": "y"}, [two], ["d"])
    check_names({"idf[omega=30]": "x", "idf (omega=30)": "y"}, iter([[], iter(two)]), ["d"])


def test_a_label_of_a_table_gets_a_new_name_and_a_pattern_does_not():
    """In the table of a sweep the preset has no name, and what all share is left out."""
    swept = [("poisson", f"depth={depth},samples=2") for depth in (9, 7)]
    assert list(naming(swept, {"poisson (depth=9)": "Ours"}).labels.values()) == ["Ours", "poisson (depth=7)"]
    check_names({"poisson (depth=9)": "Ours"}, [[("idf", "")], swept], [])
    with pytest.raises(UsageError, match=r"no table has 'pois\*'"):
        check_names({"pois*": "Ours"}, [swept], [])
    assert is_called("poisson", "depth=9", "poisson (depth=9)") and is_called("poisson", "depth=9", "poisson_9")


def frame():
    made = [("idf", "omega=30"), ("idf", ""), ("poisson", "")]
    return rows(*(row(m, c, 0, {"d": 1.0 + i}, variant=v) for i, (m, v) in enumerate(made) for c in "abcd"))


def test_results_are_chosen_by_the_name_of_a_preset():
    assert set(select(frame(), method="idf_30")["variant"]) == {"omega=30"}
    assert len(select(frame(), method="idf")) == 8 and len(select(frame(), method="idf[omega=30],poisson")) == 8
    with pytest.raises(UsageError, match="Did you mean 'idf_30'"):
        select(frame(), method="idf_31")
    assert is_called("idf", "omega=30", "idf_*") and not is_called("idf", "", "idf_30")


def test_tables_and_failures_have_the_same_names():
    made = frame()
    made.loc[0, ["status", "message"]] = ["error", "boom"]
    text = render(leaderboard(made), "terminal", rows=made)
    assert "idf_30: 1 error" in text and "(omega=30)" not in text
    (table,) = tables(leaderboard(made), look=Look(order="given", methods=("poisson", "idf_30")))
    assert table.methods == ("poisson", "idf_30", "idf")
