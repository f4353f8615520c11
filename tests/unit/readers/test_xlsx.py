"""Workbooks: the largest sheet is read as if it had been exported as text."""

import zipfile
from xml.sax.saxutils import escape

import numpy as np
import pytest

from floquid.errors import InputError
from floquid.readers import describe_file, read

pytest.importorskip("python_calamine")

SHEET = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
PLACE = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
RELATIONS = "http://schemas.openxmlformats.org/package/2006/relationships"


def cell(value):
    """A number; a date as the days since 1900 with a format; a text."""
    if isinstance(value, str):
        return f'<c t="inlineStr"><is><t>{escape(value)}</t></is></c>'
    if isinstance(value, tuple):
        return f'<c s="1"><v>{value[0]!r}</v></c>'
    return "<c/>" if value is None else f"<c><v>{value!r}</v></c>"


def workbook(path, **sheets):
    """A workbook of sheets, each a list of rows."""
    places = range(1, len(sheets) + 1)
    parts = "".join(
        f'<Override PartName="/xl/worksheets/sheet{k}.xml" ContentType='
        '"application/vnd.openxmlformats-officedocument.spreadsheetml.worksheet+xml"/>'
        for k in places
    )
    kinds = "application/vnd.openxmlformats-officedocument.spreadsheetml"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(
            "[Content_Types].xml",
            '<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">'
            '<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
            f'<Override PartName="/xl/workbook.xml" ContentType="{kinds}.sheet.main+xml"/>'
            f'<Override PartName="/xl/styles.xml" ContentType="{kinds}.styles+xml"/>{parts}</Types>',
        )
        archive.writestr(
            "_rels/.rels",
            f'<Relationships xmlns="{RELATIONS}"><Relationship Id="rId1" Type="{PLACE}/officeDocument" '
            'Target="xl/workbook.xml"/></Relationships>',
        )
        named = "".join(
            f'<sheet name="{name}" sheetId="{k}" r:id="rId{k}"/>' for k, name in zip(places, sheets, strict=True)
        )
        archive.writestr(
            "xl/workbook.xml", f'<workbook xmlns="{SHEET}" xmlns:r="{PLACE}"><sheets>{named}</sheets></workbook>'
        )
        links = "".join(
            f'<Relationship Id="rId{k}" Type="{PLACE}/worksheet" Target="worksheets/sheet{k}.xml"/>' for k in places
        )
        archive.writestr(
            "xl/_rels/workbook.xml.rels",
            f'<Relationships xmlns="{RELATIONS}">{links}<Relationship Id="rId99" Type="{PLACE}/styles" '
            'Target="styles.xml"/></Relationships>',
        )
        archive.writestr(
            "xl/styles.xml",
            f'<styleSheet xmlns="{SHEET}"><numFmts><numFmt numFmtId="164" formatCode="yyyy-mm-dd hh:mm:ss.000"/>'
            '</numFmts><cellXfs><xf numFmtId="0"/><xf numFmtId="164"/></cellXfs></styleSheet>',
        )
        for k, rows in zip(places, sheets.values(), strict=True):
            lines = "".join(f"<row>{''.join(map(cell, row))}</row>" for row in rows)
            archive.writestr(
                f"xl/worksheets/sheet{k}.xml",
                f'<worksheet xmlns="{SHEET}"><sheetData>{lines}</sheetData></worksheet>',
            )


def test_the_largest_sheet_is_read_with_its_units_and_holes(tmp_path):
    path = tmp_path / "run.xlsx"
    rows = [
        ["Run", 7],
        ["Time", "x", "y"],
        ["ms", "mm", "V"],
        *[[20 * k, k + 0.5, None if k == 2 else -k] for k in range(5)],
    ]
    workbook(path, Info=[["by", "me"]], Data=rows)
    record = read(path)
    np.testing.assert_array_equal(record.values, [[0.5, 1.5, 2.5, 3.5, 4.5], [0, -1, np.nan, -3, -4]])
    assert [(channel.name, channel.unit) for channel in record.channels] == [("x", "mm"), ("y", "V")]
    assert record.sample_rate == describe_file(path).sample_rate == 50.0
    assert "Sheet 'Data' was read, the largest of 2." in record.provenance.steps
    np.testing.assert_array_equal(read(path, channels=["y"]).values, record.values[1:])


def test_dates_are_times(tmp_path):
    path, days = tmp_path / "run.xlsx", 45413.5
    workbook(path, Sheet1=[["when", "x"], *[[(days + k / 86400.0,), k] for k in range(9)]])
    record = read(path)
    assert record.sample_rate == 1.0
    assert "The times are dates: they count from the first, 2024-05-01 12:00:00." in record.provenance.steps


def test_damage_and_another_file_are_refused(tmp_path):
    path = tmp_path / "run.xlsx"
    workbook(path, Sheet1=[["time", "x"], *[[k, k] for k in range(99)]])
    path.write_bytes(path.read_bytes()[:-30])
    with pytest.raises(InputError, match=r"be a whole workbook, but .*is not one, or is damaged or cut short"):
        read(path)
    path.write_text("time,x\n0,1\n1,2\n")
    with pytest.raises(InputError, match=r"be a whole workbook"):
        read(path)
    workbook(path, Sheet1=[["time", "x"]])
    with pytest.raises(InputError, match=r"a header and no rows"):
        read(path)
