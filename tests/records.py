"""Records for the tests of what is on disk."""

import json

import pyarrow.parquet as pq

from bench.plan.cell import Cell, Choice
from bench.results.files import COLUMNS, META_KEY
from bench.results.store import Record


def row(index=0, cell="ab0000000001", mark="f" * 16, **values):
    defaults = dict.fromkeys(COLUMNS)
    defaults |= {
        "schema_version": 1, "cell": cell, "fingerprint": mark, "task": "denoise", "dataset": "balls", "sensor": "few",
        "split": "test", "method": "jet", "variant": "", "seed": 0, "threads": 1, "device": "cpu", "host": "h",
        "tags": "", "status": "ok", "seconds": 1.0, "case": f"case-{index}", "case_index": index,
        "finished": "2026-01-01T00:00:00+00:00", "score.p2f_mean": 0.1, "floor.p2f_mean": 0.0,
    }  # fmt: skip
    return defaults | values


def cell_of(seed=0):
    """A cell of plugins that are there."""
    return Cell(
        task=Choice("task", "denoise", {}),
        dataset=Choice("dataset", "bumps", {}),
        sensor=Choice("sensor", "samples", {}),
        method=Choice("method", "identity", {}),
        metrics=(Choice("metric", "p2f_mean", {}),),
        seed=seed,
    )


def record(cell="ab0000000001", mark="f" * 16, finished="2026-01-01T00:00:00+00:00", cases=3, **values):
    rows = [row(i, cell, mark, finished=finished, **values) for i in range(cases)]
    meta = {"cell_id": cell, "fingerprint": mark, "planned": cases, "finished": finished}
    return Record(cell, mark, meta, rows)


def rewritten(file, change=lambda meta: None, table=lambda table: table):
    """Store a record with other metadata, or another table, under the name that its metadata then say."""
    old = pq.read_table(file)
    meta = json.loads(old.schema.metadata[META_KEY])
    change(meta)
    new = table(old).replace_schema_metadata({META_KEY: json.dumps(meta).encode()})
    file.unlink()
    target = file.parents[1] / meta["cell_id"][:2] / f"{meta['cell_id']}-{meta['fingerprint']}.parquet"
    target.parent.mkdir(exist_ok=True)
    pq.write_table(new, target, compression="zstd")
    return target
