"""Tables of points as text: XYZ, TXT, ASC, CSV, PTS, PWN and whatever else has one point a line.

A first look at the file finds its form: the line of names, the count of points, the separator, the decimal sign. The
rest is read by the parser of pandas, in pieces. Where it refuses, the next form that fits is tried; where all do, the
lines are looked at one by one for the first that does not fit, so that the message can name it.
"""

from __future__ import annotations

import contextlib
import csv
import io
import re
from typing import NamedTuple

import numpy as np

from ...errors import BadInput
from ...notices import notice
from ...text import shortened
from .columns import are_normals, geometry_of, plain_name
from .plain import decoded
from .raw import NO_FACES, RawGeometry

MISSING = ("nan", "NaN", "NAN", "-nan", "+nan", "-NaN", "nan(ind)", "-nan(ind)", "-nan(snan)", "nan(snan)")
MISSING += ("NA", "N/A", "n/a", "null", "NULL", "None")
NUMBER = re.compile(r"[-+]?(?:(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?|inf|infinity)", re.IGNORECASE | re.ASCII)
COMMENT = re.compile(r"\s*(?:#|//|;|%|!)+")
OTHER_COMMENTS = re.compile(rb"^[ \t]*(?:;|%|!)[^\n]*|//[^\n]*", re.MULTILINE)  # besides "#", which the parser knows
EXPONENT_OF_FORTRAN = re.compile(rb"(\d)[dD]([-+]?\d)")
EXPECTED = "expected a point a line: x y z, then its other values"
SAMPLE, HEAD = 50, 1000  # lines of numbers that are looked at first, and lines before them
PIECE = 250_000  # rows that are parsed at once
BLANKS = bytes.maketrans(b",;|", b"   ")
MOST_COLUMNS = 100


class Form(NamedTuple):
    """How the numbers of a line are written.

    Blanks separate where ``separator`` is empty; with ``"any"`` each line has a sign of its own.
    """

    separator: str
    decimal: str = "."

    @property
    def is_blank(self) -> bool:
        """Whether any number of blanks separates, so that no cell is empty."""
        return self.separator in ("", "any")

    def cells(self, line: str) -> list[str]:
        """The cells of a line, with a point for the decimal sign."""
        line = line.partition("#")[0].partition("//")[0]
        if self.separator == "any":  # each line has its own, but not two: one of them might be a decimal sign
            line = re.sub(r"\s*([,;|])\s*", r"\1", line.strip().strip(",;|"))
            kinds = {" " if mark.isspace() else mark for mark in re.findall(r"[,;|\s]", line)}
            return re.split(r"[,;|\s]+", line) if len(kinds) == 1 else [line]
        cells = [cell.strip() for cell in _split(line, self.separator)] if self.separator else line.split()
        if self.decimal == ",":  # a point would separate thousands
            return [cell.replace(".", "?").replace(",", ".") for cell in cells]
        return cells

    def __str__(self) -> str:
        words = {"": "blanks", "\t": "tabs", ";": "semicolons", ",": "commas", "|": "bars", "any": "one sign"}
        return words[self.separator] + (" and decimal commas" if self.decimal == "," else "")


FORMS = (
    Form(""),
    Form(";"),
    Form(";", ","),
    Form("\t"),
    Form("\t", ","),
    Form("", ","),
    Form(","),
    Form("|"),
    Form("any"),
)


def _split(line: str, separator: str) -> list[str]:
    """The cells of a line, of which some may be in quotation marks."""
    if '"' in line:
        with contextlib.suppress(csv.Error):  # a word too long for it
            return next(csv.reader([line], delimiter=separator, skipinitialspace=True), [""])
    return line.split(separator)


class Fit(NamedTuple):
    """A form in which the first lines of a table are written, and what they hold."""

    form: Form
    width: int  # columns
    numbers: list[int]  # those that hold numbers
    names: list[str]  # of these
    texts: list[str]  # names of columns that hold words


class Head(NamedTuple):
    """The lines above the numbers."""

    names: str  # the line of names, without its comment sign; "" where there is none
    count: int | None  # type: ignore[assignment]  # hides tuple.count; of points, where the file begins with it
    begin: int  # byte at which the numbers begin
    lines: int  # above it


def read_table(data: bytes, name: str, *, lone: str = "") -> RawGeometry:
    """The points in the text of a table, with normals, colours and scalars.

    See :func:`bench.geometry.io.columns.geometry_of` for the interpretation of columns.

    Parameters
    ----------
    data : content of the file: UTF-8, UTF-16 or Latin-1, with any line ends
    name : of the file, for messages
    lone : the name of a single scalar without one

    Raises
    ------
    BadInput
        With the number of the first line that is no row of the table, or if there are fewer points than it promises.
    """
    data = as_utf8(data, name)
    if b"1.#" in data:  # as some compilers write what is not a number
        data = re.sub(rb"1\.#(?:QNAN|SNAN|IND)\w*", b"nan", data.replace(b"1.#INF", b"inf"))
    if EXPONENT_OF_FORTRAN.search(data[:65536]):
        data = EXPONENT_OF_FORTRAN.sub(rb"\1e\2", data)
    head = _head(data, name)
    sample = _sample(data, head.begin)
    fitting = [fit for form in FORMS if (fit := _fit(form, sample, head.names))]
    for fit in fitting:
        table = _parsed(data, head.begin, fit)
        if table is not None:
            _check_count(len(table), head.count, name)
            if fit.texts:
                notice(f"{name}: ignores columns of text: {', '.join(fit.texts)[:80]}")
            if not fit.names and _has_axes(head.names) and len(fit.numbers) > 3:
                notice(f"{name}: has {fit.width} columns, but another number of names; the names are ignored")
            return geometry_of(table, fit.names, name, lone=lone)
    raise _refusal(data, head, sample, fitting, name)


def _check_count(there: int, promised: int | None, name: str) -> None:
    if promised is None or there in (promised, 2 * promised):  # twice: points, then normals
        return
    if there < promised:
        raise BadInput(
            f"{name}: ends early: it promises {promised:,} points, but the file holds {there:,}. The file is cut off; "
            "copy or export it again"
        )
    notice(f"{name}: promises {promised:,} points, and has {there:,}; all are read")


def read_pts(data: bytes, name: str) -> RawGeometry:
    """PTS: a count, then x y z, intensity, and colours; several scans may follow each other."""
    data = as_utf8(data, name)
    counts = [int(found) for found in re.findall(rb"^[ \t]*(\d{1,15})[ \t]*$", data, re.MULTILINE)]
    if len(counts) > 1:
        without = re.sub(rb"^[ \t]*\d{1,15}[ \t]*$", b"", data, flags=re.MULTILINE)
        data = b"%d\n" % sum(counts) + without
    return read_table(data, name, lone="intensity")


def read_pwn(data: bytes, name: str) -> RawGeometry:
    """PWN: points with normals, six numbers a line, or all points and then all normals; a count may come first."""
    raw = read_table(data, name)
    half, rest = divmod(len(raw.vertices), 2)
    if raw.normals is None and not raw.scalars and not rest and are_normals(raw.vertices[half:]):
        return RawGeometry(raw.vertices[:half], NO_FACES, raw.vertices[half:])
    return raw


def numbers(data: bytes, width: int, name: str, above: int = 0) -> np.ndarray:
    """Lines of ``width`` numbers with blanks between them, as an (n, width) float64 array.

    Raises
    ------
    BadInput
        With the number of the first line that is none; ``name`` is that of the file, which has ``above`` lines before.
    """
    fit = Fit(Form(""), width, list(range(width)), [], [])
    table = _parsed(data, 0, fit)
    if table is None:
        raise _refusal(data, Head("", None, 0, above), [], [fit], name)
    return table


def as_utf8(data: bytes, name: str) -> bytes:
    """Text in UTF-8 without a byte order mark, whose lines end with a line feed.

    Raises
    ------
    BadInput
        If the content is no text.
    """
    data = decoded(data)
    if b"\0" in data[:4096]:
        raise BadInput(f"{name}: is not text; {EXPECTED}")
    if b"\xc2\xa0" in data:  # blanks that do not break
        data = data.replace(b"\xc2\xa0", b" ")
    if b"\r" in data:
        data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    return data


# -- the first look ----------------------------------------------------------------------------------------------------


def _head(data: bytes, name: str) -> Head:
    """The lines before the first row of numbers."""
    names, count, at, lines = "", None, 0, 0
    while at < len(data) and lines < HEAD:
        end = data.find(b"\n", at)
        end = len(data) if end < 0 else end
        line = data[at : min(end, at + 10_000)].decode("utf-8", errors="replace").strip()
        if mark := COMMENT.match(line):
            said = line[mark.end() :].strip()
            names = said if _has_axes(said) else names
        elif line:
            words = [word.strip('"') for word in re.split(r"[,;|\s]+", line) if word]
            numbers = [bool(NUMBER.fullmatch(word)) or word in MISSING for word in words]
            if words and not numbers[0] and 2 * sum(numbers) <= len(numbers):
                names = line
                if words[0].lower() == "ncols":
                    raise BadInput(f"{name}: is a grid of heights (ESRI ASCII); {EXPECTED}. Export it as points")
            elif words and (len(words) > 1 or not words[0].isdecimal() or count is not None):
                return Head(names, count, at, lines)
            elif words:
                count = int(words[0][:15])
        at, lines = end + 1, lines + 1
    raise BadInput(f"{name}: holds no numbers{' in its first 1,000 lines' * (lines == HEAD)}; {EXPECTED}")


_AXES = {"x", "y", "z"}


def _has_axes(line: str) -> bool:
    return {plain_name(word) for word in re.split(r"[,;|\s]+", line)} >= _AXES


def _sample(data: bytes, begin: int) -> list[str]:
    """The first lines of numbers, without comments."""
    text = data[begin : begin + 65536].decode("utf-8", errors="replace")
    lines = text.split("\n")
    if len(data) > begin + 65536 and len(lines) > 1:
        lines.pop()  # it is not whole
    return [line for line in lines if line.strip() and not COMMENT.match(line)][:SAMPLE]


def _fit(form: Form, sample: list[str], names: str) -> Fit | None:
    """The columns of the lines in this form; None where they are not written in it."""
    rows = [form.cells(line) for line in sample]
    width = max((len(row) - (row[-1] == "") for row in rows), default=0)  # a separator at the end is none
    if not 3 <= width <= MOST_COLUMNS or any(_misfit(row, width, form) for row in rows):
        return None
    named = _names(names, width)
    cells = list(zip(*(row[:width] for row in rows), strict=True))
    empty = [k for k, column in enumerate(cells) if not any(column)]
    numbers = [k for k, column in enumerate(cells) if k not in empty and all(map(_is_number, filter(None, column)))]
    others = [k for k in range(width) if k not in numbers and k not in empty]
    texts = [named[k] for k in others] if named else []
    is_mixed = any(_is_number(cell) for k in others for cell in cells[k]) or _AXES & set(map(plain_name, texts))
    if len(numbers) < 3 or (others and not named) or is_mixed or (form.is_blank and empty):
        return None
    return Fit(form, width, numbers, [named[k] for k in numbers] if named else [], texts)


def _misfit(row: list[str], width: int, form: Form) -> bool:
    return len(row) != width and not (not form.is_blank and len(row) == width + 1 and not row[-1])


def _is_number(cell: str) -> bool:
    return NUMBER.fullmatch(cell) is not None or cell in MISSING


def _names(line: str, width: int) -> list[str]:
    """The names of the columns, if there are as many; the words of a last name may have blanks between them."""
    line = re.sub(r"[\[(].*?[\])]", "", line)
    for text in (line.strip("\r\n "), line.strip(" \t,;|")):
        for separator in (";", "\t", ",", "|", None):
            words = [word.strip() for word in text.split(separator)]
            if len(words) == width:
                return words
    words = line.split()
    if len(words) > width and [plain_name(word) for word in words[:3]] == ["x", "y", "z"]:
        return [*words[: width - 1], "_".join(words[width - 1 :])]
    return []


# -- all rows ----------------------------------------------------------------------------------------------------------


def _parsed(data: bytes, begin: int, fit: Fit) -> np.ndarray | None:
    """The numbers, (n, c) float64; None where the parser refuses, or may have filled in cells."""
    import pandas as pd

    form = fit.form
    source = io.BytesIO(data)  # shares the bytes
    source.seek(begin)
    if form.separator == "any" or _has_other_comments(data, begin, form):
        body = OTHER_COMMENTS.sub(b"", data[begin:])
        source = io.BytesIO(body.translate(BLANKS) if form.separator == "any" else body)
    whole = len(fit.numbers) == fit.width
    after = whole and not form.is_blank  # a separator at the end of the line, behind which there is nothing
    exact = {} if tuple(map(int, pd.__version__.split(".")[:2])) >= (3, 1) else {"float_precision": "round_trip"}
    table = np.empty((data.count(b"\n", begin) + 1, len(fit.numbers)))
    row = 0
    try:
        pieces = pd.read_csv(
            source,
            sep=r"\s+" if form.is_blank else form.separator,
            decimal=form.decimal,
            header=None,
            names=range(fit.width + after),
            usecols=None if whole else fit.numbers,  # with a choice the parser counts no cells
            index_col=False,
            dtype=np.float64,
            comment="#",
            quoting=csv.QUOTE_MINIMAL if b'"' in data else csv.QUOTE_NONE,
            skipinitialspace=True,
            na_values=[*MISSING, *([] if form.is_blank else [""])],
            keep_default_na=False,
            chunksize=PIECE,
            encoding_errors="replace",
            **exact,
        )
        for piece in pieces:
            values = piece.to_numpy()
            if after and not np.isnan(values[:, -1]).all():
                return None
            table[row : (row := row + len(values))] = values[:, : table.shape[1]]
    except (ValueError, pd.errors.ParserError):
        return None
    # The parser fills short lines, and takes any where a choice of columns is given.
    doubtful = not whole or form.separator == "any" or (after and np.isnan(table[:row, -1]).any())
    is_counted = (
        whole and len(form.separator) == 1 and data.count(form.separator.encode(), begin) == row * (fit.width - 1)
    )
    if doubtful and not is_counted and _first_wrong(data, begin, fit):
        return None
    return table[:row]


def _has_other_comments(data: bytes, begin: int, form: Form) -> bool:
    """Whether there are comments that the parser does not know; looked for by their signs, since patterns are slow."""
    signs = [sign for sign in (b";", b"%", b"!") if sign != form.separator.encode()]
    if any(data.find(sign, begin) >= 0 for sign in (b"//", *signs)):
        return OTHER_COMMENTS.search(data, begin) is not None
    return data.find(b"\n;", begin) >= 0


def _refusal(data: bytes, head: Head, sample: list[str], fitting: list[Fit], name: str) -> BadInput:
    """What is wrong with the first line that does not fit the form of the first ones."""
    fits = fitting or [fit for form in FORMS if (fit := _fit(form, sample[:1], ""))]
    if not fits:
        line = sample[0] if sample else ""
        rows = [Form(separator).cells(line) for separator in (";", "\t", ",", "|", "")]
        cells = next((row for row in rows if len(row) > 2), rows[-1])
        wrong = [cell for cell in cells if cell and not _is_number(cell)]
        if wrong and len(cells) > 2:
            return BadInput(f"{name}: line {head.lines + 1}: {_quoted(wrong[0])} is not a number; {EXPECTED}")
        return BadInput(f"{name}: has {len(cells)} column{'s' * (len(cells) != 1)}; expected 3 or more: x y z, ...")
    found = _first_wrong(data, head.begin, fits[0])
    if not found:
        return BadInput(f"{name}: cannot be read as a table; {EXPECTED}. Export it again, without quotation marks")
    number, cells = found
    where = f"{name}: line {head.lines + number}"
    if _misfit(cells, fits[0].width, fits[0].form):
        return BadInput(
            f"{where} has {len(cells)} columns; expected {fits[0].width} as in the others (separated by "
            f"{fits[0].form}). The file is cut off or damaged; export it again"
        )
    wrong = next(cells[k] for k in fits[0].numbers if cells[k] and not _is_number(cells[k]))
    return BadInput(f"{where}: {_quoted(wrong)} is not a number; {EXPECTED}")


def _first_wrong(data: bytes, begin: int, fit: Fit) -> tuple[int, list[str]] | None:
    """The first line that does not fit, counted from 1, and its cells."""
    source = io.BytesIO(data)
    source.seek(begin)
    for number, line in enumerate(source, 1):
        text = line.decode("utf-8", errors="replace")
        if not text.strip() or COMMENT.match(text):
            continue
        cells = fit.form.cells(text)
        if _misfit(cells, fit.width, fit.form):
            return number, cells
        if not all(_is_number(cells[k]) or (not cells[k] and not fit.form.is_blank) for k in fit.numbers):
            return number, cells
    return None


def _quoted(cell: str) -> str:
    return repr(shortened(cell, 40))
