"""The folder of pages: its links, what each page has, and what happens to files of an earlier site."""

from __future__ import annotations

import base64
import hashlib
import json
import re

import pytest

from bench.errors import UsageError
from bench.pages.site import MANIFEST, site, write_site


@pytest.fixture(scope="module")
def files(small_data):
    return site(small_data, {"abc": b"\0\1\2"})


@pytest.fixture(scope="module")
def folder(files, tmp_path_factory):
    made = tmp_path_factory.mktemp("site") / "public"
    write_site(made, files)
    return made


def content(files, name):
    text = files[name].partition("detailbenchData = ")[2]
    return json.loads(text.rstrip().removesuffix(";"))


def test_there_is_a_page_for_each_dataset_and_method(files):
    pages = {name for name in files if name.endswith(".html")}
    methods = {f"method/{name}.html" for name in ("poisson", "rimls", "apss", "ball_pivoting", "alpha_wrap")}
    assert pages == {"index.html", "dataset/bumps.html", "dataset/cad.html"} | methods


def test_each_page_has_the_rows_that_concern_it(files, small_data):
    rows = {
        name: content(files, f"data/{name}.js")["cases"]["count"] for name in ("index", "dataset-cad", "method-apss")
    }
    assert rows == {"index": 80, "dataset-cad": 40, "method-apss": 16}
    cad = content(files, "data/dataset-cad.js")
    assert {group["dataset"] for group in cad["groups"]} == {"cad"}
    assert cad["about"]["shapes"] == 4 and sum(one["count"] for one in cad["failures"]) == 2
    assert cad["cases"]["columns"]["dataset"]["values"] == ["cad"]
    rimls = content(files, "data/method-rimls.js")
    assert rimls["focus"] == "rimls" and rimls["groups"] == content(files, "data/index.js")["groups"]
    names = rimls["cases"]["columns"]["method"]
    assert {names["values"][names["codes"][trace["row"]]] for trace in rimls["traces"]} == {"rimls"}
    assert len(rimls["traces"]) == 16


def test_the_files_are_scripts_that_no_text_breaks(files):
    for name, text in files.items():
        if name.startswith(("data/", "geometry/")):
            assert "<" not in text
    assert files["geometry/abc.js"] == '(globalThis.detailbenchGeometry ??= {})["abc"] = "AAEC";\n'


def test_pages_open_from_the_disk_and_lead_to_each_other(visit, folder):
    page = visit(folder / "index.html", allowed=folder)
    assert page.locator("main tbody tr").count() == 5
    page.locator("main tbody a", has_text="rimls").click()
    page.wait_for_selector("h1:has-text('rimls')")
    assert re.search(r"method/rimls\.html$", page.url.partition("#")[0])
    assert page.locator("main tr.selected").count() == 1
    page.get_by_label("Pages by dataset").select_option(label="cad")
    page.wait_for_selector("h1:has-text('cad')")
    page.get_by_role("link", name="All results").click()
    page.wait_for_selector("strong:has-text('All results')")


@pytest.mark.parametrize("foreign", ["<script>evil = 1</script>", "<script src='evil.js'></script>",
                                     "<img src='x' onerror='evil = 1'>", "<base href='elsewhere/'>"])  # fmt: skip
def test_the_rule_of_a_page_lets_no_foreign_script_run(window, files, folder, foreign):
    """Foreign text in the page itself, which the program never writes there: nothing of it is obeyed."""
    (folder / "evil.js").write_text("evil = 1")
    path = folder / "foreign.html"
    path.write_text(files["index.html"].replace("<body>", f"<body>{foreign}"))
    page, refused = window(), []

    def listen(message):
        refused.append(message.text)

    page.on("console", listen)
    page.goto(f"file://{path}")
    page.wait_for_selector("main tbody tr")
    assert page.evaluate("typeof evil") == "undefined"
    assert any("Content Security Policy" in text for text in refused)
    page.remove_listener("console", listen)


def test_each_page_has_the_digest_of_its_script_in_its_rule(files):
    for name, text in files.items():
        if name.endswith(".html"):
            (script,) = re.findall(r"<script>(.*?)</script>", text, re.DOTALL)
            digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
            (rule,) = re.findall(r'Content-Security-Policy" content="(.*?)"', text)
            assert f"script-src &#x27;sha256-{digest}&#x27; &#x27;strict-dynamic&#x27;" in rule
            assert text.count("<script") == 1


def test_a_new_site_takes_stale_pages_away_and_nothing_else(files, tmp_path):
    write_site(tmp_path / "site", files)
    own = tmp_path / "site" / "CNAME"
    own.write_text("example.org")
    manifest = json.loads((tmp_path / "site" / MANIFEST).read_text())
    manifest["files"] += ["CNAME", "../outside", "data/../../outside"]
    (tmp_path / "site" / MANIFEST).write_text(json.dumps(manifest))
    (tmp_path / "outside").write_text("x")
    fewer = {name: text for name, text in files.items() if "apss" not in name}
    write_site(tmp_path / "site", fewer)
    assert not (tmp_path / "site/method/apss.html").exists() and (tmp_path / "site/method/rimls.html").exists()
    assert own.exists() and (tmp_path / "outside").exists()


def test_a_folder_of_something_else_is_refused(files, tmp_path):
    (tmp_path / "thesis.tex").write_text("x")
    with pytest.raises(UsageError, match="not empty and holds no site"):
        write_site(tmp_path, files)
    with pytest.raises(UsageError, match="is a file"):
        write_site(tmp_path / "thesis.tex", files)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]
