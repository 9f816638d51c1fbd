"""Records for the tests of what is on disk."""

from bench.results.files import COLUMNS
from bench.results.store import Record


def row(index=0, cell="ab0000000001", mark="f" * 16, **values):
    defaults = dict.fromkeys(COLUMNS)
    defaults |= {
        "schema_version": 1, "cell": cell, "fingerprint": mark, "task": "denoise", "dataset": "balls", "sensor": "few",
        "method": "jet", "variant": "", "seed": 0, "threads": 1, "device": "cpu", "host": "h", "tags": "",
        "status": "ok", "seconds": 1.0, "case": f"case-{index}", "case_index": index,
        "finished": "2026-01-01T00:00:00+00:00", "score.p2f_mean": 0.1, "floor.p2f_mean": 0.0,
    }  # fmt: skip
    return defaults | values


def record(cell="ab0000000001", mark="f" * 16, finished="2026-01-01T00:00:00+00:00", cases=3, **values):
    rows = [row(i, cell, mark, finished=finished, **values) for i in range(cases)]
    meta = {"cell_id": cell, "fingerprint": mark, "planned": cases, "finished": finished}
    return Record(cell, mark, meta, rows)
