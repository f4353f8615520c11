"""The benchmark in small: a run is judged by its truth, and the table counts what is right."""

import json
from dataclasses import replace

import numpy as np
from benchmarks.tachometer import __main__ as tachometer
from benchmarks.tachometer.rig import Rig

RIG = Rig(rpm=1800.0)


def test_the_pulses_and_the_wander_are_as_asked_for():
    rig = replace(RIG, wander=0.001, width=0.2)
    angles = rig.clock(rig.times)
    speed = np.gradient(angles, rig.times)
    assert abs(np.std(speed) / speed.mean() / 0.001 - 1.0) < 0.3
    assert abs(np.mean(rig.record().values[-1] > 2.5) / 0.2 - 1.0) < 0.05


def test_the_command_prints_a_table_and_writes_rows(tmp_path, capsys):
    place = tmp_path / "rows.json"
    assert (
        tachometer.main(
            ["--speeds", "1800", "--widths", "0.05", "--rates", "1024", "--wanders", "0", "--out", str(place)]
        )
        == 0
    )
    (row,) = json.loads(place.read_text())
    assert (row["outcome"], row["found"], row["false"], row["period_fitted"]) == ("passed", 4, 0, True)
    assert "1 of 1 with 4 modes, none false, passed" in capsys.readouterr().out


def test_what_is_off_is_found_to_be(monkeypatch):
    honest = tachometer.floquid.identify

    def shifted(record):
        found = honest(record, validate=False)
        off = found.model.exponents * np.where(np.abs(found.model.exponents.imag) > 300.0, 1.3, 1.0)
        return replace(found, model=replace(found.model, exponents=off, estimates=None))

    monkeypatch.setattr(tachometer.floquid, "identify", shifted)
    row = tachometer.judged(RIG, 60.0)
    assert (row.found, row.false, row.right) == (3, 1, False)
